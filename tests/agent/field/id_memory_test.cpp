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

/// What is promised, in the plainest way: of each id when it may go, and never more than the limit.
struct PlainMemory {
  std::vector<IdMemory::Entry> entries;  ///< the oldest first

  auto find(const std::string& id, SteadyTime now) {
    forget_old(now);
    return std::find_if(entries.begin(), entries.end(),
                        [&](const IdMemory::Entry& entry) { return entry.id == id; });
  }
  bool make_room(SteadyTime now) {
    forget_old(now);
    if (entries.size() < 10000) return true;
    const auto oldest = std::find_if(entries.begin(), entries.end(),
                                     [now](const auto& entry) { return may_go(entry, now); });
    if (oldest == entries.end()) return false;
    entries.erase(oldest);
    return true;
  }

 private:
  static bool may_go(const IdMemory::Entry& entry, SteadyTime now) {
    return entry.over && now > entry.deadline;
  }
  void forget_old(SteadyTime now) {
    std::erase_if(entries, [now](const IdMemory::Entry& entry) {
      return may_go(entry, now) && now - entry.seen >= hours(24);
    });
  }
};

TEST(IdMemory, KnowsWhatAPlainListKnows) {
  int full = 0;
  for (const unsigned seed : {1U, 2U, 3U, 4U}) {
    std::minstd_rand random(seed);
    const auto below = [&](unsigned limit) { return static_cast<int>(random() % limit); };
    const bool hurry = seed % 2 == 0;  // all within the first minutes: no deadline passes
    IdMemory memory;
    PlainMemory plain;
    SteadyTime now = kStart;
    std::uint64_t arrival = 0;
    const auto add = [&](const std::string& id) {
      const IdMemory::Entry entry{id, ++arrival, now, now + minutes(10 + below(50)),
                                  below(50) != 0};
      memory.add(entry, now);
      plain.entries.push_back(entry);
    };
    while (memory.size() < kRememberedIds - 200) add("early" + std::to_string(memory.size()));
    for (int i = 0; i < 2000; ++i) {
      if (!hurry && below(200) == 0) now += minutes(below(1500));
      now += std::chrono::milliseconds(below(hurry ? 100 : 3000));
      const std::string id = std::to_string(below(3000));
      const auto known = plain.find(id, now);
      const IdMemory::Entry* found = memory.find(id, now);
      ASSERT_EQ(found != nullptr, known != plain.entries.end()) << i;
      if (found != nullptr) {
        ASSERT_EQ(found->over, known->over) << i;
        if (below(3) != 0) continue;
        memory.finish(id, nullptr);
        known->over = true;
        continue;
      }
      const bool room = plain.make_room(now);
      ASSERT_EQ(memory.make_room(now), room) << i;
      full += !room;
      if (!room) continue;
      add(id);
      ASSERT_LE(memory.size(), kRememberedIds);
    }
  }
  EXPECT_GT(full, 100);
}

TEST(IdMemory, IdThatIsKnownStaysAsItIs) {
  IdMemory memory;
  memory.add({"a", 1, kStart, kStart}, kStart);
  memory.add({"a", 2, kStart, kStart + hours(1), true}, kStart);
  EXPECT_EQ(memory.size(), 1U);
  EXPECT_EQ(memory.find("a", kStart)->arrival, 1U);
  EXPECT_FALSE(memory.find("a", kStart)->over);
}

// What an earlier run leaves is not in the order of this one's.
TEST(IdMemory, DayIsOverWhateverStandsBefore) {
  IdMemory memory;
  memory.add({"runs", 1, kStart, kStart}, kStart);
  memory.add({"young", 2, kStart, kStart, true}, kStart);
  memory.add({"old", 3, kStart - hours(23), kStart, true}, kStart);
  const SteadyTime later = kStart + hours(1);
  EXPECT_NE(memory.find("young", later), nullptr);
  EXPECT_EQ(memory.find("old", later), nullptr);
  memory.add({"old", 4, later, later}, later);
  ASSERT_NE(memory.find("old", later), nullptr);
  EXPECT_EQ(memory.find("old", later)->arrival, 4U);
  EXPECT_NE(memory.find("runs", later + hours(30)), nullptr);
}

// A file that opens late brings ids of earlier commands.
TEST(IdMemory, EarlierCommandsAreOlderWheneverTheyBecomeKnown) {
  IdMemory memory;
  for (std::uint64_t i = 0; i < 500; ++i)
    memory.add({"own" + std::to_string(i), 20000 + i, kStart, kStart, true}, kStart);
  for (std::uint64_t i = 0; i < kRememberedIds; ++i)
    memory.add({"early" + std::to_string(i), i, kStart - hours(1), kStart, true}, kStart);
  const SteadyTime later = kStart + minutes(1);
  EXPECT_TRUE(memory.make_room(later));
  EXPECT_NE(memory.find("own0", later), nullptr);
  EXPECT_EQ(memory.find("early500", later), nullptr);
  EXPECT_NE(memory.find("early501", later), nullptr);
}

TEST(IdMemory, TooManyAreLetGoAtOnce) {
  IdMemory memory;
  for (std::size_t i = 0; i < kRememberedIds + 50; ++i)
    memory.add({std::to_string(i), i, kStart, kStart, true}, kStart);
  const SteadyTime later = kStart + minutes(1);
  EXPECT_TRUE(memory.make_room(later));
  EXPECT_EQ(memory.size(), kRememberedIds - 1);
  EXPECT_EQ(memory.find("50", later), nullptr);
  EXPECT_NE(memory.find("51", later), nullptr);
}

TEST(IdMemory, ResultIsKeptWhereItIsGiven) {
  IdMemory memory;
  memory.add({"a", 1, kStart, kStart}, kStart);
  CommandResult result;
  result.id = "a";
  memory.finish("a", std::make_shared<const CommandResult>(result));
  memory.finish("b", nullptr);
  EXPECT_TRUE(memory.find("a", kStart)->over);
  EXPECT_EQ(memory.find("a", kStart)->result->id, "a");
  EXPECT_EQ(memory.find("b", kStart), nullptr);
}

}  // namespace
}  // namespace fxagent
