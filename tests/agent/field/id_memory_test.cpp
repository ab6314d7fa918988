#include "agent/field/id_memory.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <random>
#include <string>
#include <utility>
#include <vector>

namespace fxagent {
namespace {

using std::chrono::hours;
using std::chrono::minutes;

constexpr SteadyTime kStart{hours(1000)};

/// The same in the plainest way: a list that is walked from its beginning.
struct PlainMemory {
  std::vector<IdMemory::Entry> entries;

  auto find(const std::string& id) {
    return std::find_if(entries.begin(), entries.end(),
                        [&](const IdMemory::Entry& entry) { return entry.id == id; });
  }
  bool make_room(SteadyTime now) {
    const auto may_go = [&](const IdMemory::Entry& entry) {
      return entry.over && now > entry.deadline;
    };
    while (!entries.empty() && may_go(entries[0]) && now - entries[0].seen >= hours(24))
      entries.erase(entries.begin());
    if (entries.size() < 10000) return true;
    const auto oldest = std::find_if(entries.begin(), entries.end(), may_go);
    if (oldest == entries.end()) return false;
    entries.erase(oldest);
    return true;
  }
};

TEST(IdMemory, DoesWhatAPlainListDoes) {
  for (const unsigned seed : {1U, 2U, 3U}) {
    std::minstd_rand random(seed);
    const auto below = [&](unsigned limit) { return static_cast<int>(random() % limit); };
    IdMemory memory;
    PlainMemory plain;
    SteadyTime now = kStart;
    const auto add = [&](const std::string& id) {
      const IdMemory::Entry entry{id, now, now + minutes(below(60)), below(50) != 0};
      memory.add(entry);
      plain.entries.push_back(entry);
    };
    while (memory.size() < IdMemory::kMost - 200) add("early" + std::to_string(memory.size()));
    for (int i = 0; i < 2000; ++i) {
      now += below(400) == 0 ? minutes(below(1500)) : minutes(0);
      now += std::chrono::milliseconds(below(3000));
      const std::string id = std::to_string(below(3000));
      const auto known = plain.find(id);
      ASSERT_EQ(memory.find(id) != nullptr, known != plain.entries.end()) << i;
      if (known != plain.entries.end()) {
        ASSERT_EQ(memory.find(id)->over, known->over) << i;
        if (below(3) != 0) continue;
        memory.finish(id, nullptr);
        known->over = true;
        continue;
      }
      const bool room = plain.make_room(now);
      ASSERT_EQ(memory.make_room(now), room) << i;
      if (!room) continue;
      add(id);
      ASSERT_EQ(memory.size(), plain.entries.size());
    }
  }
}

TEST(IdMemory, IdThatIsKnownStaysAsItIs) {
  IdMemory memory;
  memory.add({"a", kStart, kStart});
  memory.add({"a", kStart, kStart + hours(1), true});
  EXPECT_EQ(memory.size(), 1U);
  EXPECT_FALSE(memory.find("a")->over);
  EXPECT_EQ(memory.find("a")->deadline, kStart);
}

TEST(IdMemory, ResultIsKeptWhereItIsGiven) {
  IdMemory memory;
  memory.add({"a", kStart, kStart});
  CommandResult result;
  result.id = "a";
  memory.finish("a", std::make_shared<const CommandResult>(result));
  memory.finish("b", nullptr);
  EXPECT_TRUE(memory.find("a")->over);
  EXPECT_EQ(memory.find("a")->result->id, "a");
  EXPECT_EQ(memory.find("b"), nullptr);
}

}  // namespace
}  // namespace fxagent
