// Polls of a device whose protocol can read several places in one frame.

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/agent/field/poller_plant.h"
#include "tests/protocol/gathering_codec.h"
#include "tests/support/pick.h"

namespace fxagent::test {
namespace {

using std::chrono::hours;
using std::chrono::milliseconds;
using std::chrono::nanoseconds;
using State = DeviceStatus::State;

constexpr int kLocked = 5;

/// While a password locks the device, it answers every request with kLocked.
class LockingCodec final : public GatheringCodec {
 public:
  explicit LockingCodec(const GatheringCodec& other) : GatheringCodec(other) {}
  RefusalMeaning meaning_of(const Request& request, int code) const override {
    return code == kLocked ? RefusalMeaning::unclear : GatheringCodec::meaning_of(request, code);
  }
};

/// A device for the made-up protocol of GatheringCodec: words that count up, with holes, limits and
/// temporary refusals chosen by the test.
class FakeGatherer final {
 public:
  std::map<unsigned, unsigned> words;  ///< W5 as 5; V5 as 10005
  std::set<unsigned> lacks;            ///< same numbering
  std::set<unsigned> not_gathered;     ///< refused only within a Gather
  std::set<unsigned> unknown_commands;
  std::set<unsigned> dropped_commands;  ///< never answered
  std::set<unsigned> garbled_commands;  ///< answered with nonsense
  std::size_t most_parts = 1000;
  int in_a_mood = 0;  ///< number of answers that will be `mood`
  int mood = 0;
  bool silent = false;
  std::vector<std::string> asked;  ///< "W10+60" for a single read, "1: W5 W900+2" for a command

  Bytes answer(ByteView frame) {
    Bytes image;
    std::string text;
    bool whole = true;
    const unsigned command = number(frame, 2 + 8);
    for (std::size_t at = 2; at + 10 <= frame.size(); at += 10) {
      const unsigned first = number(frame, at) * 10000 + number(frame, at + 2) / 16;
      const unsigned count = number(frame, at + 4) / 16;
      text += (text.empty() ? "" : " ") + std::string(first < 10000 ? "W" : "V") +
              std::to_string(first % 10000) + (count == 1 ? "" : "+" + std::to_string(count));
      for (unsigned n = first; n < first + count; ++n) {
        whole = whole && !lacks.contains(n) && !(command != 0 && not_gathered.contains(n));
        const auto known = words.find(n);
        const unsigned value = known == words.end() ? n : known->second;
        image.push_back(static_cast<std::uint8_t>(value));
        image.push_back(static_cast<std::uint8_t>(value >> 8));
      }
    }
    asked.push_back((command == 0 ? "" : std::to_string(command) + ": ") + text);
    if (silent || dropped_commands.contains(command)) return {};
    if (garbled_commands.contains(command))
      return {static_cast<std::uint8_t>(frame[0] + 100U), 'D', 0};
    const auto no = [&](int code) { return Bytes{frame[0], 'N', static_cast<std::uint8_t>(code)}; };
    if (in_a_mood > 0) {
      --in_a_mood;
      return no(mood);
    }
    if (unknown_commands.contains(command)) return no(GatheringCodec::kUnknownCommand);
    const std::size_t parts = (frame.size() - 2) / 10;
    if (!whole || (command != 0 && parts > most_parts)) return no(GatheringCodec::kHole);
    Bytes reply{frame[0], 'D', static_cast<std::uint8_t>(image.size())};
    reply.insert(reply.end(), image.begin(), image.end());
    return reply;
  }

 private:
  static unsigned number(ByteView frame, std::size_t at) {
    return frame.size() < at + 2 ? 0U : frame[at] + frame[at + 1] * 256U;
  }
};

/// Two gather commands: 24 words or double words, and 12 blocks.
struct GatherPolls : PollerTest {
  GatherPolls() {
    config.links.push_back({"line1", SerialSettings{}, nanoseconds(0)});
    add_device("plc");
  }
  DeviceConfig& add_device(const std::string& name) {
    DeviceConfig device = device_on("modbus-tcp", nullptr, name);
    device.codec = std::make_shared<const GatheringCodec>(codec);
    device.groups[0].interval = milliseconds(10);
    config.devices.push_back(device);
    return config.devices.back();
  }
  void use_codec() {
    for (DeviceConfig& device : config.devices)
      device.codec = std::make_shared<const GatheringCodec>(codec);
  }
  void add_tags(const std::vector<std::string>& addresses) {
    DeviceConfig& device = config.devices[0];
    for (const std::string& address : addresses)
      device.tags.push_back(tag(*device.codec, address, address));
  }
  /// W0, W200, W400 …
  void add_scattered(unsigned number) {
    for (unsigned n = 0; n < number; ++n) add_tags({"W" + std::to_string(200 * n)});
  }
  /// Replaces the plant by a new one that is not yet started.
  void begin_anew() {
    poller.reset();
    state.reset();
    bus.reset();
    devices.clear();
    scheduler = PollScheduler();
    wire = nullptr;
    telemetry.clear();
    newest.clear();
    plc = {};
    config.devices.clear();
    add_device("plc");
  }
  Bytes answer(ByteView request) override { return plc.answer(request); }
  /// Runs steps until a new sample arrives.
  const Telemetry& next_sample() {
    const std::size_t seen = telemetry.size();
    steps_until([&] { return telemetry.size() > seen; });
    return telemetry.back();
  }
  std::int64_t value(const Telemetry& message, std::size_t index) {
    const auto& got = message.readings.at(index).value;
    return std::get<std::int64_t>(got.items.at(0));
  }

  GatheringCodec codec = [] {
    GatheringCodec made = gathering_codec();
    made.commands = {{1, 24}};
    return made;
  }();
  FakeGatherer plc;
};

TEST_F(GatherPolls, ScatteredTagsAreOneExchange) {
  add_tags({"W5", "W900", "W901", "V30", "B37"});
  plc.words[10000 + 2] = 0x20;  // B37 is bit 5 of the third word
  start();
  const Telemetry& message = next_sample();
  EXPECT_EQ(plc.asked, std::vector<std::string>{"1: W5 W900+2 V2 V30"});
  ASSERT_EQ(message.readings.size(), 5U);
  EXPECT_EQ(bad(message), 0U);
  EXPECT_EQ(value(message, 0), 5);
  EXPECT_EQ(value(message, 1), 900);
  EXPECT_EQ(value(message, 2), 901);
  EXPECT_EQ(value(message, 3), 10030);
  EXPECT_EQ(message.readings[4].value, Value(Scalar(true)));
  EXPECT_FALSE(message.span_ms) << "all of it is of one moment";
  EXPECT_EQ(newest[0].state, State::online);
}

TEST_F(GatherPolls, BlocksAndScatteredTagsGoBesideEachOther) {
  for (int n = 100; n < 160; ++n) add_tags({"W" + std::to_string(n)});
  add_tags({"W900", "V30"});
  start();
  EXPECT_EQ(bad(next_sample()), 0U);
  EXPECT_EQ(plc.asked, (std::vector<std::string>{"W100+60", "1: W900 V30"}));
}

TEST_F(GatherPolls, ADeviceThatLacksTheCommandIsReadWithoutItAndNothingIsBad) {
  add_scattered(3);
  plc.unknown_commands = {1};
  start();
  EXPECT_EQ(bad(next_sample()), 0U);
  EXPECT_EQ(plc.asked, (std::vector<std::string>{"1: W0 W200 W400", "W0", "W200", "W400"}));
  plc.asked.clear();
  EXPECT_EQ(bad(next_sample()), 0U);
  EXPECT_EQ(plc.asked.size(), 3U) << "it is not asked that way again";
  EXPECT_EQ(newest[0].state, State::online);
}

TEST_F(GatherPolls, ADeviceThatRefusesEverythingDoesNotLackTheCommand) {
  config.devices[0].codec = std::make_shared<const LockingCodec>(codec);
  add_scattered(3);
  plc.in_a_mood = 2;
  plc.mood = kLocked;
  start();
  testing::internal::CaptureStderr();
  EXPECT_EQ(bad(next_sample()), 3U);
  EXPECT_EQ(bad(next_sample()), 3U);
  EXPECT_EQ(bad(next_sample()), 0U);
  EXPECT_EQ(plc.asked, (std::vector<std::string>(3, "1: W0 W200 W400")));
  const std::string log = testing::internal::GetCapturedStderr();
  const auto told = log.find("reason=\"no 5\"");
  ASSERT_NE(told, log.npos) << log;
  EXPECT_EQ(log.find("no 5", told + 9), log.npos) << "once, not each time";
}

TEST_F(GatherPolls, TheOtherCommandIsTriedBeforeNone) {
  codec.commands = {{1, 24}, {2, 12}};
  use_codec();
  add_scattered(3);
  plc.unknown_commands = {1};
  start();
  EXPECT_EQ(bad(next_sample()), 0U);
  EXPECT_EQ(plc.asked, (std::vector<std::string>{"1: W0 W200 W400", "2: W0 W200 W400"}));
}

TEST_F(GatherPolls, OneHoleIsFoundAndEverythingElseGoesTogetherAgain) {
  add_scattered(16);
  plc.lacks = {1000};  // the sixth
  start();
  steps_until([&] { return telemetry.size() > 6 && bad(telemetry.back()) == 1; });
  plc.asked.clear();
  const Telemetry& settled = next_sample();
  EXPECT_EQ(settled.readings[5].bad, BadReason::nak);
  EXPECT_EQ(bad(settled), 1U);
  ASSERT_EQ(plc.asked.size(), 1U);
  EXPECT_EQ(plc.asked[0].find("W1000"), std::string::npos) << plc.asked[0];
  EXPECT_EQ(newest[0].state, State::degraded);
}

TEST_F(GatherPolls, AMissingPlaceMakesNoOtherBad) {
  add_scattered(16);
  plc.lacks = {1000};
  start();
  for (int samples = 0; samples < 20; ++samples) {
    const Telemetry& message = next_sample();
    EXPECT_EQ(bad(message), 1U) << samples;
    EXPECT_EQ(message.readings[5].bad, BadReason::nak);
  }
}

TEST_F(GatherPolls, WhateverIsMissingNoOtherPlaceIsBad) {
  Pick pick(20261123);
  for (int round = 0; round < 100; ++round) {
    SCOPED_TRACE(round);
    begin_anew();
    std::vector<unsigned> words;
    for (unsigned n = pick(1, 60); n > 0; --n) words.push_back(pick(0, 3) * 700 + pick(0, 60));
    for (const unsigned word : words) add_tags({"W" + std::to_string(word)});
    const auto one = [&] { return words[pick(0, 1000) % words.size()]; };
    for (unsigned n = pick(0, 3); n > 0; --n) plc.lacks.insert(one());
    for (unsigned n = pick(0, 2); n > 0; --n) plc.not_gathered.insert(one());
    if (pick(0, 2) == 0) plc.most_parts = pick(1, 12);
    start();
    for (int samples = 0; samples < 5; ++samples) {
      const Telemetry& message = next_sample();
      for (std::size_t i = 0; i < words.size(); ++i) {
        EXPECT_EQ(message.readings[i].bad.has_value(), plc.lacks.contains(words[i])) << words[i];
        if (!message.readings[i].bad) {
          EXPECT_EQ(value(message, i), words[i]);
        }
      }
    }
  }
}

TEST_F(GatherPolls, CommandsGoBetweenTheReadsThatFindAMissingPlace) {
  add_scattered(16);
  plc.lacks = {1000};
  start();
  step();
  ASSERT_EQ(plc.asked.size(), 1U);
  EXPECT_TRUE(telemetry.empty());
  scheduler.share().command_waits();
  EXPECT_EQ(scheduler.next(now).kind, PollScheduler::Job::Kind::command);
  scheduler.share().command_taken();
  while (telemetry.empty()) {
    const std::size_t before = plc.asked.size();
    step();
    EXPECT_LE(plc.asked.size(), before + 1);
  }
  EXPECT_LE(plc.asked.size(), 11U) << "two for each time that 16 places are halved, and two more";
}

TEST_F(GatherPolls, APlaceThatIsOnlyRefusedInCompanyIsReadByItself) {
  add_scattered(16);
  plc.not_gathered = {1000};
  start();
  steps_until([&] { return telemetry.size() > 3 && bad(telemetry.back()) == 0; });
  plc.asked.clear();
  EXPECT_EQ(bad(next_sample()), 0U);
  EXPECT_EQ(plc.asked.size(), 2U);
  EXPECT_NE(std::find(plc.asked.begin(), plc.asked.end(), "W1000"), plc.asked.end());
}

TEST_F(GatherPolls, ADeviceThatTakesFewerPlacesGetsFewer) {
  add_scattered(16);
  plc.most_parts = 5;
  start();
  steps_until([&] { return telemetry.size() > 2 && bad(telemetry.back()) == 0; });
  next_sample();
  plc.asked.clear();
  EXPECT_EQ(bad(next_sample()), 0U);
  EXPECT_EQ(plc.asked.size(), 4U);
  EXPECT_EQ(newest[0].state, State::online);
}

TEST_F(GatherPolls, ABusyDeviceIsAskedForTheSameAgain) {
  add_scattered(3);
  for (const int mood : {GatheringCodec::kBusy, GatheringCodec::kCurable}) {
    plc.in_a_mood = 1;
    plc.mood = mood;
    if (!poller) start();
    plc.asked.clear();
    EXPECT_EQ(bad(next_sample()), 0U);
    EXPECT_EQ(plc.asked, (std::vector<std::string>{"1: W0 W200 W400", "1: W0 W200 W400"}));
  }
}

TEST_F(GatherPolls, ADeviceThatNeverAnswersTheCommandIsReadWithoutIt) {
  add_scattered(3);
  config.devices[0].retries = 0;
  plc.dropped_commands = {1};
  start();
  steps_until([&] { return !telemetry.empty() && bad(telemetry.back()) == 0; });
  EXPECT_EQ(std::count(plc.asked.begin(), plc.asked.end(), "1: W0 W200 W400"), 2);
  plc.asked.clear();
  EXPECT_EQ(bad(next_sample()), 0U);
  EXPECT_EQ(plc.asked, (std::vector<std::string>{"W0", "W200", "W400"}));
  EXPECT_EQ(newest[0].state, State::online);
}

TEST_F(GatherPolls, ADeviceThatAnswersTheCommandWithNonsenseIsReadWithoutIt) {
  add_scattered(3);
  plc.garbled_commands = {1};
  start();
  steps_until([&] { return !telemetry.empty() && bad(telemetry.back()) == 0; });
  plc.asked.clear();
  EXPECT_EQ(bad(next_sample()), 0U);
  EXPECT_EQ(plc.asked, (std::vector<std::string>{"W0", "W200", "W400"}));
}

TEST_F(GatherPolls, ADeviceThatWasSilentIsReadTogetherAgain) {
  add_scattered(3);
  config.devices[0].retries = 0;
  start();
  next_sample();
  for (int times = 0; times < 5; ++times) {
    plc.silent = true;
    steps_until([&] { return newest[0].state == State::offline; });
    plc.silent = false;
    plc.asked.clear();
    EXPECT_EQ(bad(next_sample()), 0U);
    EXPECT_EQ(plc.asked, (std::vector<std::string>{"W0", "1: W0 W200 W400"}));
    steps_until([&] { return newest[0].state == State::online; });
  }
}

TEST_F(GatherPolls, SilenceMakesAllOfItBad) {
  add_scattered(3);
  config.devices[0].retries = 0;
  plc.silent = true;
  start();
  const Telemetry& message = next_sample();
  for (const TagReading& reading : message.readings) EXPECT_EQ(reading.bad, BadReason::timeout);
  EXPECT_EQ(newest[0].state, State::offline);
  plc.silent = false;
  steps_until([&] { return newest[0].state == State::online; });
}

TEST_F(GatherPolls, WhatACommandMayHaveChangedIsReadAgainByItself) {
  for (int n = 100; n < 160; ++n) add_tags({"W" + std::to_string(n)});
  add_tags({"W3000", "V30"});
  start();
  step();
  ASSERT_EQ(plc.asked.size(), 1U);
  step();
  next_sample();
  plc.asked.clear();
  // The gather is not the last exchange of the cycle.
  const Plan& plan = devices[0]->groups[0]->cycle.reads().plan();
  ASSERT_EQ(plan.exchange_count(), 2U);
  step();
  poller->overwritten(*devices[0], {0, 100 * 16, 16}, nullptr, BadReason::nak);
  plc.words[100] = 7;
  const Telemetry& message = next_sample();
  EXPECT_EQ(plc.asked, (std::vector<std::string>{"W100+60", "W100+60", "1: W3000 V30"}));
  EXPECT_EQ(value(message, 0), 7);
}

TEST_F(GatherPolls, AnOutdatedPartIsReadWithoutTheOthers) {
  add_tags({"W5", "W900", "V30"});
  for (int n = 100; n < 160; ++n) add_tags({"V" + std::to_string(n)});
  start();
  step();
  ASSERT_EQ(plc.asked, std::vector<std::string>{"1: W5 W900 V30"});
  poller->overwritten(*devices[0], {0, 900 * 16, 16}, nullptr, BadReason::nak);
  plc.words[900] = 7;
  const Telemetry& message = next_sample();
  EXPECT_EQ(plc.asked, (std::vector<std::string>{"1: W5 W900 V30", "1: W900", "V100+60"}));
  EXPECT_EQ(value(message, 0), 5);
  EXPECT_EQ(value(message, 1), 7);
  EXPECT_EQ(bad(message), 0U);
}

TEST_F(GatherPolls, TheLongestPollIsThatOfTheWholeFrame) {
  config.links[0].char_time = std::chrono::microseconds(1042);
  config.devices[0].groups[0].interval = hours(1);
  add_scattered(20);
  start();
  const Plan& plan = devices[0]->groups[0]->cycle.reads().plan();
  ASSERT_EQ(plan.exchange_count(), 1U);
  EXPECT_EQ(poller->longest_poll(), plan.line_time);
}

}  // namespace
}  // namespace fxagent::test
