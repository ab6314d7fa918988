#include "agent/commands/id_memory.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <random>

namespace fxagent {
namespace {

using std::chrono::hours;
using std::chrono::minutes;

constexpr SteadyTime kStart{hours(1000)};

/// A simple reference implementation of the promises: when each id may be forgotten, and the limits
/// on their number.
struct PlainMemory {
  struct Known {
    IdMemory::Entry entry;
    bool refused = false;
    bool print = false;  ///< only the fingerprint is kept
  };
  std::vector<Known> all;  ///< oldest first
  std::size_t most_prints = 300;
  int dropped = 0;  ///< refused ids removed to make room

  Known* find(const std::string& id, SteadyTime now) {
    for (Known& known : all)
      if (known.entry.id == id && !is_old(known, now)) return &known;
    return nullptr;
  }
  bool make_room(SteadyTime now) {
    forget_old(now);
    if (count(false, false) < kRememberedIds) return true;
    const bool room = count(false, true) < most_prints || drop_print(now);
    for (Known& known : all) {
      if (known.refused || known.print || !known.entry.over) continue;
      if (room) {
        known.print = true;
        return true;
      }
      if (now <= known.entry.deadline) continue;
      all.erase(all.begin() + (&known - all.data()));
      return true;
    }
    return false;
  }
  void add(IdMemory::Entry entry) {
    all.push_back({std::move(entry)});
    drop_refused();
  }
  void add_refused(IdMemory::Entry entry, SteadyTime now) {
    forget_old(now);
    all.push_back({std::move(entry), true});
    drop_refused();
  }

 private:
  static bool is_old(const Known& known, SteadyTime now) {
    return known.entry.over && now > known.entry.deadline && now - known.entry.seen >= hours(24);
  }
  void forget_old(SteadyTime now) {
    std::erase_if(all, [now](const Known& known) { return is_old(known, now); });
  }
  std::size_t count(bool refused, bool print) const {
    return static_cast<std::size_t>(std::count_if(all.begin(), all.end(), [&](const Known& known) {
      return known.refused == refused && known.print == print;
    }));
  }
  void drop_refused() {
    const std::size_t refused = count(true, false);
    if (refused <= kRememberedRefused || refused + count(false, false) <= kRememberedIds) return;
    all.erase(
        std::find_if(all.begin(), all.end(), [](const Known& known) { return known.refused; }));
    ++dropped;
  }
  bool drop_print(SteadyTime now) {
    const auto oldest = std::find_if(all.begin(), all.end(), [now](const Known& known) {
      return known.print && now > known.entry.deadline;
    });
    if (oldest == all.end()) return false;
    all.erase(oldest);
    return true;
  }
};

struct Memory {
  std::shared_ptr<SharedAdmission> room = std::make_shared<SharedAdmission>();
  IdMemory ids{room, "press1"};
};

TEST(IdMemory, KnowsWhatAPlainListKnows) {
  int full = 0;
  int prints = 0;
  int refused = 0;
  for (const unsigned seed : {1U, 2U}) {
    std::minstd_rand random(seed);
    const auto below = [&](unsigned limit) { return static_cast<int>(random() % limit); };
    const bool hurry = seed % 2 == 0;  // all within the first minutes: no deadline passes
    Memory memory;
    PlainMemory plain;
    SteadyTime now = kStart;
    std::uint64_t number = 0;
    const auto add = [&](const std::string& id) {
      const IdMemory::Entry entry{id, ++number, now, now + minutes(10 + below(50)), below(50) != 0};
      memory.ids.add(entry, now);
      return entry;
    };
    while (memory.ids.size() < kRememberedIds - 100)
      plain.all.push_back({add("early" + std::to_string(memory.ids.size()))});
    for (std::size_t i = 0; i < kRememberedRefused - 100; ++i) {
      const IdMemory::Entry entry{"no" + std::to_string(i), ++number, now, now, true};
      memory.ids.add_refused(entry, now);
      plain.all.push_back({entry, true});
    }
    memory.room->fingerprints = IdFingerprints(plain.most_prints);
    for (std::size_t i = 0; i < plain.most_prints - 50; ++i) {
      memory.room->fingerprints.add("other", std::to_string(i), now, now + hours(30));
      plain.all.push_back(
          {{"other " + std::to_string(i), 0, now, now + hours(30), true}, false, true});
    }
    for (int i = 0; i < 1500; ++i) {
      if (!hurry && below(50) == 0) now += minutes(below(700));
      now += std::chrono::milliseconds(below(hurry ? 100 : 3000));
      const int kind = below(8);
      const std::string id = (kind < 2    ? "early"
                              : kind == 2 ? "no"
                                          : "") +
                             std::to_string(below(1800));
      auto* known = plain.find(id, now);
      const auto found = memory.ids.find(id, now);
      ASSERT_EQ(found.has_value(), known != nullptr) << seed << " " << i << " " << id;
      if (found) {
        ASSERT_EQ(found->over, known->entry.over) << i;
        ASSERT_EQ(found->number.has_value(), !known->print) << i;
        prints += known->print;
        if (below(3) != 0 || known->refused) continue;
        memory.ids.finish(id, {});
        known->entry.over = true;
        continue;
      }
      if (below(3) == 0) {
        const IdMemory::Entry entry{id, ++number, now, now, true};
        plain.add_refused(entry, now);
        memory.ids.add_refused(entry, now);
        continue;
      }
      const bool room = plain.make_room(now);
      ASSERT_EQ(memory.ids.make_room(now), room) << seed << " " << i;
      full += !room;
      if (!room) continue;
      plain.add(add(id));
      ASSERT_LE(memory.ids.size(), kRememberedIds + kRememberedRefused);
    }
    refused += plain.dropped;
  }
  EXPECT_GT(full, 50);
  EXPECT_GT(prints, 0);
  EXPECT_GT(refused, 50);
}

TEST(IdMemory, IdThatIsKnownStaysAsItIs) {
  Memory memory;
  memory.ids.add({"a", 1, kStart, kStart}, kStart);
  memory.ids.add({"a", 2, kStart, kStart + hours(1), true}, kStart);
  EXPECT_EQ(memory.ids.size(), 1U);
  EXPECT_EQ(memory.ids.find("a", kStart)->number, 1U);
  EXPECT_FALSE(memory.ids.find("a", kStart)->over);
}

// Ids of an earlier run are not in this run's order.
TEST(IdMemory, DayIsOverWhateverStandsBefore) {
  Memory memory;
  memory.ids.add({"runs", 1, kStart, kStart}, kStart);
  memory.ids.add({"young", 2, kStart, kStart, true}, kStart);
  memory.ids.add({"old", 3, kStart - hours(23), kStart, true}, kStart);
  const SteadyTime later = kStart + hours(1);
  EXPECT_TRUE(memory.ids.find("young", later));
  EXPECT_FALSE(memory.ids.find("old", later));
  memory.ids.add({"old", 4, later, later}, later);
  ASSERT_TRUE(memory.ids.find("old", later));
  EXPECT_EQ(memory.ids.find("old", later)->number, 4U);
  EXPECT_TRUE(memory.ids.find("runs", later + hours(30)));
}

// A file that opens late adds ids of earlier commands.
TEST(IdMemory, EarlierCommandsAreOlderWheneverTheyBecomeKnown) {
  Memory memory;
  for (std::uint64_t i = 0; i < 500; ++i)
    memory.ids.add({"own" + std::to_string(i), 20000 + i, kStart, kStart, true}, kStart);
  for (std::uint64_t i = 0; i < kRememberedIds; ++i)
    memory.ids.add({"early" + std::to_string(i), i, kStart - hours(1), kStart, true}, kStart);
  const SteadyTime later = kStart + minutes(1);
  EXPECT_TRUE(memory.ids.make_room(later));
  EXPECT_TRUE(memory.ids.find("own0", later)->number);
  EXPECT_FALSE(memory.ids.find("early500", later)->number) << "only its fingerprint is left";
  EXPECT_TRUE(memory.ids.find("early501", later)->number);
  EXPECT_EQ(memory.ids.size(), kRememberedIds - 1);
}

// A flood of reads with deadlines an hour away does not block other clients.
TEST(IdMemory, TwoHundredThousandAreKnownUntilTheirDeadlines) {
  Memory memory;
  const std::size_t most = kRememberedIds + kFingerprints;
  for (std::size_t i = 0; i < most; ++i) {
    ASSERT_TRUE(memory.ids.make_room(kStart)) << i;
    memory.ids.add({std::to_string(i), i, kStart, kStart + hours(1), true}, kStart);
  }
  EXPECT_FALSE(memory.ids.make_room(kStart + hours(1)));
  for (std::size_t i = 0; i < most; ++i)
    ASSERT_TRUE(memory.ids.find(std::to_string(i), kStart + hours(1))) << i;
  const SteadyTime later = kStart + hours(1) + minutes(1);
  EXPECT_TRUE(memory.ids.make_room(later));
  EXPECT_FALSE(memory.ids.find("0", later));
  EXPECT_TRUE(memory.ids.find("1", later));
}

// A repeat of a refused command stays refused, however many others were carried out.
TEST(IdMemory, WhatWasRefusedStandsInNobodysWayAndIsRemembered) {
  Memory memory;
  for (std::uint64_t i = 0; i < 3 * kRememberedIds; ++i)
    memory.ids.add_refused({"no" + std::to_string(i), i, kStart, kStart, true}, kStart);
  EXPECT_EQ(memory.ids.size(), kRememberedIds);
  EXPECT_FALSE(memory.ids.find("no0", kStart));
  EXPECT_TRUE(memory.ids.find("no29999", kStart));
  for (std::uint64_t i = 0; i < kRememberedIds; ++i) {
    ASSERT_TRUE(memory.ids.make_room(kStart));
    memory.ids.add({"yes" + std::to_string(i), i, kStart, kStart + hours(1)}, kStart);
  }
  EXPECT_EQ(memory.room->fingerprints.size(), 0U);
  EXPECT_EQ(memory.ids.size(), kRememberedIds + kRememberedRefused);
  EXPECT_FALSE(memory.ids.find("no27999", kStart));
  EXPECT_TRUE(memory.ids.find("no28000", kStart));
  memory.ids.add_refused({"no", 30000, kStart, kStart, true}, kStart);
  EXPECT_TRUE(memory.ids.find("no", kStart));
}

TEST(IdMemory, DevicesDoNotShareTheirIds) {
  Memory memory;
  IdMemory other(memory.room, "press2");
  memory.room->fingerprints.add("press1", "a", kStart, kStart);
  EXPECT_TRUE(memory.ids.find("a", kStart));
  EXPECT_FALSE(other.find("a", kStart));
}

TEST(IdMemory, ResultIsKeptWhereItIsGiven) {
  Memory memory;
  memory.ids.add({"a", 1, kStart, kStart}, kStart);
  memory.ids.finish("a", memory.room->keep(R"({"id":"a"})", SharedAdmission::ResultOf::admitted));
  memory.ids.finish("b", {});
  EXPECT_TRUE(memory.ids.find("a", kStart)->over);
  EXPECT_EQ(*memory.ids.find("a", kStart)->result, R"({"id":"a"})");
  EXPECT_FALSE(memory.ids.find("b", kStart));
}

}  // namespace
}  // namespace fxagent
