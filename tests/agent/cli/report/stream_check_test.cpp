#include "agent/cli/report/stream_check.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <random>

#include "agent/config/model.h"
#include "tests/support/effort.h"

namespace fxagent {
namespace {

using nlohmann::json;

const std::string kBase = "fx/plant-a/edge7";
using Ranges = std::vector<NumberRange>;

std::string topic(const std::string& group = "fast", const std::string& device = "press1") {
  return kBase + "/" + device + "/data/" + group;
}

json sample(std::uint64_t seq, const std::string& boot = "b1") {
  return {{"ts", 1790000000000 + seq},
          {"seq", seq},
          {"boot", boot},
          {"meta", "m"},
          {"values", {{"temp", seq}}}};
}

/// A check of one device that must send.
struct Bench {
  explicit Bench(BootSkip skip = BootSkip::allowed) : check(kBase, {"press1"}, skip) {}

  void live(std::uint64_t seq, const std::string& boot = "b1", const std::string& group = "fast") {
    check.take(topic(group), sample(seq, boot).dump(), false);
  }
  void history(const std::vector<std::uint64_t>& seqs, const std::string& boot = "b1",
               const std::string& group = "fast") {
    json rows = json::array();
    for (const std::uint64_t seq : seqs) rows.push_back(sample(seq, boot));
    check.take(topic(group) + "/history", json{{"history", true}, {"rows", rows}}.dump(), false);
  }
  DeviceStream report() const { return check.report().at(0); }

  StreamCheck check;
};

struct StreamCheckTest : ::testing::Test {
  Bench bench;
};

TEST_F(StreamCheckTest, UnbrokenNumbersOverAllGroupsAreWhole) {
  for (std::uint64_t seq = 100; seq < 200; ++seq) bench.live(seq, "b1", seq % 3 ? "fast" : "slow");
  const DeviceStream report = bench.report();
  EXPECT_TRUE(report.is_whole());
  EXPECT_EQ(report.live, 100U);
  EXPECT_EQ(report.distinct, 100U);
  EXPECT_EQ(report.seen, (NumberRange{100, 199}));
  EXPECT_EQ(report.boots, std::vector<std::string>{"b1"});
  EXPECT_EQ(report.disordered + report.ts_backward + report.repeated, 0U);
}

TEST_F(StreamCheckTest, GapIsNamedUntilHistoryFillsIt) {
  bench.live(5);
  bench.live(10);
  bench.live(12);
  EXPECT_EQ(bench.report().missing.numbers, 5U);
  EXPECT_EQ(bench.report().missing.listed, (Ranges{{6, 9}, {11, 11}}));
  EXPECT_FALSE(bench.report().is_whole());
  bench.history({6, 7, 8});
  EXPECT_EQ(bench.report().missing.listed, (Ranges{{9, 9}, {11, 11}}));
  bench.history({9, 11});
  EXPECT_TRUE(bench.report().is_whole());
  EXPECT_EQ(bench.report().history, 5U);
}

TEST_F(StreamCheckTest, GapThatMayHavePassedUnheardIsNotProvable) {
  bench.live(5);
  bench.live(7);
  EXPECT_EQ(bench.report().missing.listed, (Ranges{{6, 6}}));
  bench.check.interrupted();
  EXPECT_EQ(bench.report().unprovable.listed, (Ranges{{6, 6}})) << "it may have come meanwhile";
  EXPECT_EQ(bench.report().missing.numbers, 0U);
  bench.history({9});
  bench.live(11);
  bench.live(13);
  EXPECT_EQ(bench.report().unprovable.listed, (Ranges{{6, 6}, {8, 8}, {10, 10}}));
  EXPECT_EQ(bench.report().missing.listed, (Ranges{{12, 12}}));
  bench.history({12});
  EXPECT_TRUE(bench.report().is_sound());
  EXPECT_FALSE(bench.report().is_whole());
  bench.history({6, 8, 10});
  EXPECT_TRUE(bench.report().is_whole());
}

TEST_F(StreamCheckTest, EachInterruptionMovesWhatIsProvable) {
  bench.live(1);
  bench.check.interrupted();
  bench.check.interrupted();  // before anything came
  bench.live(3);
  bench.live(5);
  EXPECT_EQ(bench.report().missing.listed, (Ranges{{4, 4}}));
  bench.check.interrupted();
  bench.live(7);
  bench.live(9);
  EXPECT_EQ(bench.report().unprovable.listed, (Ranges{{2, 2}, {4, 4}, {6, 6}}));
  EXPECT_EQ(bench.report().missing.listed, (Ranges{{8, 8}}));
}

TEST_F(StreamCheckTest, BootThatBeganUnheardHasLeftNothingOutForCertain) {
  bench.live(5);
  bench.check.interrupted();
  bench.live(9, "b2");
  EXPECT_EQ(bench.report().unprovable.listed, (Ranges{{6, 8}}));
  EXPECT_EQ(bench.report().skipped.numbers, 0U);
}

TEST_F(StreamCheckTest, OnlyTheFirstRangesAreListedAndAllAreCounted) {
  for (std::uint64_t seq = 0; seq <= 60; seq += 3) bench.live(seq);
  const NumberRanges missing = bench.report().missing;
  EXPECT_EQ(missing.ranges, 20U);
  EXPECT_EQ(missing.numbers, 40U);
  ASSERT_EQ(missing.listed.size(), NumberRanges::kMostListed);
  EXPECT_EQ(missing.listed.back(), (NumberRange{28, 29}));
}

TEST_F(StreamCheckTest, WhatLiesBeforeTheFirstLiveSampleMayHaveComeEarlier) {
  bench.history({50, 60});
  bench.live(100);
  bench.history({70});
  bench.live(101);
  const DeviceStream report = bench.report();
  EXPECT_TRUE(report.is_whole());
  EXPECT_EQ(report.seen, (NumberRange{50, 101}));
}

TEST_F(StreamCheckTest, DeviceWithoutALiveSampleIsNotWhole) {
  EXPECT_FALSE(bench.report().is_whole());
  EXPECT_FALSE(bench.report().seen);
  bench.history({1, 2, 9});
  EXPECT_FALSE(bench.report().decided);
  EXPECT_EQ(bench.report().missing.numbers, 0U);
  EXPECT_FALSE(bench.report().is_whole());
}

TEST(StreamCheck, DeviceThatNobodyExpectedMaySendHistoryAlone) {
  StreamCheck check(kBase, {}, BootSkip::allowed);
  check.take(topic("fast", "old") + "/history",
             json{{"rows", json::array({sample(1), sample(9)})}}.dump(), false);
  ASSERT_EQ(check.report().size(), 1U);
  EXPECT_TRUE(check.report()[0].is_whole());
  EXPECT_FALSE(check.report()[0].expected);
}

TEST_F(StreamCheckTest, RepeatIsToldFromANumberThatWasUsedTwice) {
  for (std::uint64_t seq = 1; seq <= 5; ++seq) bench.live(seq);
  bench.history({3, 4});
  EXPECT_EQ(bench.report().repeated, 2U);
  EXPECT_EQ(bench.report().differing, 0U);
  EXPECT_TRUE(bench.report().is_whole());
  bench.live(2, "b2");
  json other = sample(5);
  other["values"]["temp"] = -1;
  bench.check.take(topic(), other.dump(), false);
  EXPECT_EQ(bench.report().repeated, 4U);
  EXPECT_EQ(bench.report().differing, 2U);
  EXPECT_FALSE(bench.report().is_whole());
}

TEST_F(StreamCheckTest, OrderOfKeysAndSpacesDoNotMakeAnotherSample) {
  bench.live(7);
  bench.check.take(topic(), sample(7).dump(3), false);
  EXPECT_EQ(bench.report().differing, 0U);
  EXPECT_EQ(bench.report().repeated, 1U);
}

TEST_F(StreamCheckTest, NewBootMayLeaveNumbersOutOnceButOnlyBetweenTheBoots) {
  bench.live(10);
  bench.live(11);
  bench.live(1011, "b2");
  bench.live(1012, "b2");
  EXPECT_TRUE(bench.report().is_whole());
  EXPECT_EQ(bench.report().skipped.listed, (Ranges{{12, 1010}}));
  EXPECT_EQ(bench.report().boots, (std::vector<std::string>{"b1", "b2"}));
  // The samples a crash left on disk arrive as history, with the old boot.
  bench.history({12, 14});
  EXPECT_EQ(bench.report().missing.listed, (Ranges{{13, 13}}));
  EXPECT_EQ(bench.report().skipped.listed, (Ranges{{15, 1010}}));
  bench.live(1020, "b2");
  EXPECT_EQ(bench.report().missing.listed, (Ranges{{13, 13}, {1013, 1019}}));
}

TEST(StreamCheck, NewBootMaySkipUnlessEverySampleIsOnDiskOfAnAgentThatWorksAlone) {
  Config config;
  EXPECT_EQ(boot_skip(config), BootSkip::allowed);
  config.store.path = "store";
  config.store.sync_always = true;
  EXPECT_EQ(boot_skip(config), BootSkip::is_loss);
  config.pair.emplace();
  EXPECT_EQ(boot_skip(config), BootSkip::allowed) << "each takeover skips about a million";
}

TEST(StreamCheck, NewBootLeavesNothingOutWhereEverySampleIsOnDisk) {
  Bench bench(BootSkip::is_loss);
  bench.live(10);
  bench.live(13, "b2");
  EXPECT_EQ(bench.report().missing.listed, (Ranges{{11, 12}}));
  EXPECT_EQ(bench.report().skipped.numbers, 0U);
}

TEST_F(StreamCheckTest, BootThatBeganWhileListeningIsJudgedThoughTheClockWentBack) {
  bench.live(5000);
  bench.live(100, "b2");
  bench.live(103, "b2");
  EXPECT_EQ(bench.report().missing.listed, (Ranges{{101, 102}}));
  EXPECT_EQ(bench.report().skipped.listed, (Ranges{{104, 4999}}));
}

TEST_F(StreamCheckTest, OldBootSeenInHistoryAloneIsNotJudged) {
  bench.history({1, 5}, "b0");
  bench.live(100, "b1");
  bench.history({7}, "b0");
  EXPECT_TRUE(bench.report().is_whole());
  EXPECT_EQ(bench.report().skipped.numbers, 0U);
}

TEST_F(StreamCheckTest, DisorderCountsWithinATopicAlone) {
  bench.live(10, "b1", "slow");
  bench.live(13, "b1", "fast");
  bench.live(11, "b1", "slow");
  EXPECT_EQ(bench.report().disordered, 0U);
  bench.live(12, "b1", "fast");
  bench.history({14, 16, 15});
  EXPECT_EQ(bench.report().disordered, 2U);
  EXPECT_TRUE(bench.report().is_whole());
}

TEST_F(StreamCheckTest, EarlierTimeOfAHigherNumberIsCounted) {
  bench.live(1);
  json back = sample(2);
  back["ts"] = 1789999999999;
  bench.check.take(topic(), back.dump(), false);
  bench.live(3);
  EXPECT_EQ(bench.report().ts_backward, 1U);
  EXPECT_TRUE(bench.report().is_whole());
}

TEST_F(StreamCheckTest, OtherTopicsAndRetainedMessagesAreIgnored) {
  bench.live(1);
  bench.check.take(topic(), sample(9).dump(), true);
  for (const std::string& other :
       {kBase + "/press1/state", kBase + "/press1/data", kBase + "/press1/data/a/b",
        std::string("fx/other/press1/data/x"), kBase + "x/press1/data/fast"})
    bench.check.take(other, sample(9).dump(), false);
  EXPECT_EQ(bench.report().live, 1U);
  EXPECT_EQ(bench.check.report().size(), 1U);
}

TEST_F(StreamCheckTest, GroupMayBeCalledHistory) {
  bench.live(1, "b1", "history");
  bench.history({2}, "b1", "history");
  EXPECT_EQ(bench.report().live, 1U);
  EXPECT_EQ(bench.report().history, 1U);
}

TEST_F(StreamCheckTest, WhatIsNoSampleIsCountedWithItsReason) {
  bench.live(1);
  const auto good = sample(2);
  const auto spoilt = [&good](const char* key, const json& value) {
    json bad = good;
    bad[key] = value;
    return bad.dump();
  };
  const std::vector<std::pair<std::string, std::string>> cases{
      {"", "not JSON"},
      {"[1]", "object"},
      {"{", "not JSON"},
      {"\"\xFF\"", "not JSON"},
      {spoilt("seq", -1), "seq"},
      {spoilt("seq", 1.5), "seq"},
      {spoilt("seq", "12x"), "seq"},
      {spoilt("seq", ""), "seq"},
      {spoilt("seq", "99999999999999999999"), "seq"},
      {spoilt("ts", "1"), "ts"},
      {spoilt("boot", 1), "boot"},
      {std::string(1000000, '['), "not JSON"}};
  for (const auto& [payload, why] : cases) {
    Bench fresh;
    fresh.check.take(topic(), payload, false);
    EXPECT_EQ(fresh.report().malformed, 1U) << payload.substr(0, 80);
    EXPECT_NE(fresh.report().malformed_why.find(why), std::string::npos)
        << fresh.report().malformed_why;
    EXPECT_FALSE(fresh.report().is_whole());
    bench.check.take(topic() + "/history", payload, false);
  }
  EXPECT_EQ(bench.report().malformed, cases.size());
  bench.check.take(topic() + "/history", R"({"rows":[1,{"seq":2}]})", false);
  EXPECT_EQ(bench.report().malformed, cases.size() + 2);
}

TEST_F(StreamCheckTest, NumbersBeyondADoubleComeAsStrings) {
  const std::uint64_t top = ~std::uint64_t{0};
  for (const std::uint64_t seq : {top - 2, top}) {
    json large = sample(seq);
    large["ts"] = 1;
    large["seq"] = std::to_string(seq);
    bench.check.take(topic(), large.dump(), false);
  }
  EXPECT_EQ(bench.report().missing.listed, (Ranges{{top - 1, top - 1}}));
}

TEST(StreamCheck, DevicesAreJudgedEachForItself) {
  StreamCheck check(kBase, {"press1", "press2"}, BootSkip::allowed);
  check.take(topic("fast", "press1"), sample(1).dump(), false);
  check.take(topic("fast", "press1"), sample(2).dump(), false);
  check.take(topic("fast", "press2"), sample(1).dump(), false);
  check.take(topic("fast", "press2"), sample(3).dump(), false);
  const auto report = check.report();
  EXPECT_TRUE(report.at(0).is_whole());
  EXPECT_FALSE(report.at(1).is_whole());
}

// ---- random streams against a reference check that looks at every number -----------------------

struct Receipt {
  std::uint64_t seq = 0;
  std::string boot;
  std::int64_t ts = 0;
  int value = 0;
  bool live = false;
  std::string topic;
};

/// The samples of a device over a few boots that arrive, in order of arrival.
std::vector<Receipt> random_stream(std::mt19937& random) {
  const auto chance = [&random](int percent) { return static_cast<int>(random() % 100) < percent; };
  const int loss = static_cast<int>(random() % 8);
  std::vector<Receipt> arrivals;
  std::vector<Receipt> kept;  // will be sent as history
  std::uint64_t seq = 20 + random() % 20;
  const int boots = 1 + static_cast<int>(random() % 4);
  for (int boot = 0; boot < boots; ++boot) {
    bool away = boot == 0 && chance(50);
    for (int i = static_cast<int>(random() % 40); i > 0; --i) {
      if (chance(8)) away = !away;
      const std::string group = chance(70) ? "fast" : "slow";
      Receipt made{seq++, "b" + std::to_string(boot),
                   0,     static_cast<int>(random() % 3),
                   !away, topic(group)};
      made.ts = 1000 + static_cast<std::int64_t>(made.seq) - (chance(5) ? 50 : 0);
      if (chance(loss)) continue;
      if (away) {
        made.topic += "/history";
        kept.push_back(made);
      } else {
        arrivals.push_back(made);
      }
      if (!away && chance(5)) {  // not acknowledged: sent again as history
        made.live = false;
        made.topic += "/history";
        kept.push_back(made);
      }
      while (!away && !kept.empty() && chance(60)) {
        arrivals.push_back(kept.front());
        kept.erase(kept.begin());
      }
    }
    if (chance(50)) seq += random() % 30;                                // a crash
    if (chance(10)) seq -= std::min<std::uint64_t>(seq, random() % 40);  // a clock set back
  }
  while (!kept.empty() && chance(95)) {
    arrivals.push_back(kept.front());
    kept.erase(kept.begin());
  }
  for (std::size_t i = 1; i < arrivals.size(); ++i)
    if (chance(4)) std::swap(arrivals[i - 1], arrivals[i]);
  return arrivals;
}

/// A literal, slow implementation of the rules.
DeviceStream judged_by_hand(const std::vector<Receipt>& arrivals, BootSkip skip) {
  DeviceStream out;
  std::map<std::uint64_t, Receipt> first;
  std::map<std::string, std::uint64_t> whole_from;
  std::set<std::string> boots;
  for (std::size_t i = 0; i < arrivals.size(); ++i) {
    const Receipt& a = arrivals[i];
    ++(a.live ? out.live : out.history);
    if (const auto known = first.find(a.seq); known != first.end()) {
      ++out.repeated;
      const Receipt& k = known->second;
      if (k.boot != a.boot || k.ts != a.ts || k.value != a.value) ++out.differing;
      continue;
    }
    first.emplace(a.seq, a);
    if (boots.insert(a.boot).second) out.boots.push_back(a.boot);
    if (a.live && !whole_from.contains(a.boot)) whole_from[a.boot] = out.decided ? 0 : a.seq;
    out.decided = out.decided || a.live;
    const Receipt* highest = nullptr;
    for (const auto& [seq, known] : first)
      if (known.topic == a.topic && seq != a.seq && (highest == nullptr || seq > highest->seq))
        highest = &known;
    if (highest != nullptr && highest->seq > a.seq) ++out.disordered;
    if (highest != nullptr && highest->seq < a.seq && a.ts < highest->ts) ++out.ts_backward;
  }
  out.distinct = first.size();
  if (first.empty()) return out;
  out.seen = NumberRange{first.begin()->first, first.rbegin()->first};

  const auto is_missing = [&](std::uint64_t number) {
    auto above = first.begin();
    while (above->first < number) ++above;
    const Receipt& under = std::prev(above)->second;
    const auto from = whole_from.find(under.boot);
    if (above->first == number || from == whole_from.end() || under.seq < from->second) return 0;
    if (under.boot == above->second.boot || skip == BootSkip::is_loss) return 1;
    for (const auto& [seq, each] : first)
      if ((seq > under.seq && each.boot == under.boot) ||
          (seq < above->first && each.boot == above->second.boot))
        return 1;
    return 2;
  };
  for (const int kind : {1, 2}) {
    NumberRanges& ranges = kind == 1 ? out.missing : out.skipped;
    std::optional<NumberRange> open;
    for (std::uint64_t number = out.seen->first + 1; number <= out.seen->last; ++number) {
      const bool hit = is_missing(number) == kind;
      if (hit && !open) open = NumberRange{number, number};
      if (hit) open->last = number;
      if (!hit && open) ranges.add(*std::exchange(open, std::nullopt));
    }
  }
  return out;
}

bool operator==(const NumberRanges& a, const NumberRanges& b) {
  return a.numbers == b.numbers && a.ranges == b.ranges && a.listed == b.listed;
}

TEST(StreamCheck, AgreesWithAJudgeThatLooksAtEveryNumber) {
  std::mt19937 random(20261121);
  std::uint64_t missing = 0;
  std::uint64_t skipped = 0;
  std::uint64_t whole = 0;
  for (int round = 0; round < test::effort(3000); ++round) {
    const BootSkip skip = round % 4 == 0 ? BootSkip::is_loss : BootSkip::allowed;
    const std::vector<Receipt> arrivals = random_stream(random);
    StreamCheck check(kBase, {"press1"}, skip);
    for (std::size_t i = 0; i < arrivals.size();) {
      const auto text = [](const Receipt& a) {
        return json{{"seq", a.seq}, {"boot", a.boot}, {"ts", a.ts}, {"values", {{"v", a.value}}}};
      };
      if (arrivals[i].live) {
        check.take(arrivals[i].topic, text(arrivals[i]).dump(), false);
        ++i;
        continue;
      }
      json rows = json::array();  // neighbours on one history topic share a message
      const std::string& on = arrivals[i].topic;
      for (; i < arrivals.size() && !arrivals[i].live && arrivals[i].topic == on; ++i)
        rows.push_back(text(arrivals[i]));
      check.take(on, json{{"history", true}, {"rows", rows}}.dump(), false);
    }
    const DeviceStream by_hand = judged_by_hand(arrivals, skip);
    const DeviceStream report = check.report().at(0);
    ASSERT_EQ(report.live, by_hand.live) << round;
    ASSERT_EQ(report.history, by_hand.history) << round;
    ASSERT_EQ(report.distinct, by_hand.distinct) << round;
    ASSERT_EQ(report.seen, by_hand.seen) << round;
    ASSERT_EQ(report.decided, by_hand.decided) << round;
    ASSERT_EQ(report.repeated, by_hand.repeated) << round;
    ASSERT_EQ(report.differing, by_hand.differing) << round;
    ASSERT_EQ(report.disordered, by_hand.disordered) << round;
    ASSERT_EQ(report.ts_backward, by_hand.ts_backward) << round;
    ASSERT_EQ(report.boots, by_hand.boots) << round;
    ASSERT_TRUE(report.missing == by_hand.missing) << round;
    ASSERT_TRUE(report.skipped == by_hand.skipped) << round;
    missing += report.missing.numbers;
    skipped += report.skipped.numbers;
    if (report.is_whole()) ++whole;
  }
  // The random streams covered every case.
  constexpr auto kMany = static_cast<std::uint64_t>(test::effort(3000));
  EXPECT_GT(missing, kMany);
  EXPECT_GT(skipped, kMany);
  EXPECT_GT(whole, kMany / 10);
}

}  // namespace
}  // namespace fxagent
