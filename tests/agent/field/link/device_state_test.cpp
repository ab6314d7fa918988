#include "agent/field/link/device_state.h"

#include <gtest/gtest.h>

#include "tests/agent/field/field_plant.h"

namespace fxagent::test {
namespace {

using State = DeviceStatus::State;

DeviceState::Facts bus_is_open() {
  DeviceState::Facts facts;
  facts.bus_open = true;
  return facts;
}

TEST(DeviceState, StartsOfflineAndHasNothingToTellBeforeTheFirstAnswer) {
  DeviceState state(7, *port_codec(), 1000);
  EXPECT_EQ(state.reported().device, 7U);
  EXPECT_EQ(state.reported().state, State::offline);
  EXPECT_EQ(state.reported().reason, "starting");
  EXPECT_EQ(state.reported().model, "FX3U");
  EXPECT_EQ(state.reported().since_ms, 1000);
  EXPECT_FALSE(state.update(bus_is_open(), 1100));
}

/// The state of a device that has just answered for the first time.
struct DeviceStateAnswered : ::testing::Test {
  DeviceStateAnswered() { state.answered(); }
  DeviceState state{0, *port_codec(), 1000};
};

TEST_F(DeviceStateAnswered, AnsweredIsOnlineAndToldOnce) {
  const auto change = state.update(bus_is_open(), 1100).value();
  EXPECT_TRUE(change.other_state);
  EXPECT_EQ(change.status.state, State::online);
  EXPECT_TRUE(change.status.reason.empty());
  EXPECT_EQ(change.status.since_ms, 1100);
  EXPECT_FALSE(state.update(bus_is_open(), 1200));
}

TEST_F(DeviceStateAnswered, ValueThatComesAndGoesDoesNotFlap) {
  auto bad = bus_is_open();
  bad.first_bad = BadReason::bad_value;
  bad.bad_tag = "tag temp at D100";
  const auto first = state.update(bad, 2000).value();
  EXPECT_EQ(first.status.state, State::degraded);
  EXPECT_EQ(first.status.reason, "bad_value");
  EXPECT_EQ(first.status.reason_text, "tag temp at D100");
  for (std::int64_t ms = 3000; ms < 60'000; ms += 2000) {
    EXPECT_FALSE(state.update(bus_is_open(), ms)) << ms;
    EXPECT_FALSE(state.update(bad, ms + 1000)) << ms;
  }
  EXPECT_FALSE(state.update(bus_is_open(), 69'999));
  const auto good = state.update(bus_is_open(), 70'000).value();
  EXPECT_EQ(good.status.state, State::online);
  EXPECT_EQ(good.status.since_ms, 70'000);
  EXPECT_EQ(good.status.reason_text, "");
}

TEST_F(DeviceStateAnswered, TagsThatAreBadInTurnAreNamedEachTenSeconds) {
  DeviceState::Facts a{.bus_open = true, .first_bad = BadReason::nak, .bad_tag = "tag a"};
  DeviceState::Facts b = a;
  b.bad_tag = "tag b";
  EXPECT_EQ(state.update(a, 2000)->status.reason_text, "tag a");
  for (std::int64_t ms = 3000; ms < 12'000; ms += 1000)
    EXPECT_FALSE(state.update(ms % 2000 == 0 ? a : b, ms)) << ms;
  const auto later = state.update(b, 12'000).value();
  EXPECT_EQ(later.status.reason_text, "tag b");
  EXPECT_EQ(later.status.since_ms, 2000);
  EXPECT_FALSE(later.other_state);
}

TEST_F(DeviceStateAnswered, TextBelongsToTheReason) {
  DeviceState::Facts facts = bus_is_open();
  facts.first_bad = BadReason::bad_value;
  facts.bad_tag = "tag a";
  EXPECT_EQ(state.update(facts, 2000)->status.reason_text, "tag a");
  facts.first_bad = BadReason::nak;
  facts.bad_tag = "tag b";
  EXPECT_EQ(state.update(facts, 3000)->status.reason_text, "tag b");
  const auto held = state.update(bus_is_open(), 4000).value();
  EXPECT_EQ(held.status.reason, "bad_value");
  EXPECT_EQ(held.status.reason_text, "tag a");
}

TEST_F(DeviceStateAnswered, BadValueEndsThoughTheClockWasSetBack) {
  auto bad = bus_is_open();
  bad.first_bad = BadReason::bad_value;
  ASSERT_TRUE(state.update(bad, 3'600'000));
  EXPECT_EQ(state.update(bus_is_open(), 5000).value().status.state, State::online);
}

TEST_F(DeviceStateAnswered, BadValueThatEndedDoesNotComeBackWithAClockThatIsSetBack) {
  auto bad = bus_is_open();
  bad.first_bad = BadReason::bad_value;
  ASSERT_TRUE(state.update(bad, 100'000));
  ASSERT_EQ(state.update(bus_is_open(), 111'000).value().status.state, State::online);
  EXPECT_FALSE(state.update(bus_is_open(), 101'000));
}

TEST_F(DeviceStateAnswered, OtherReasonsEndWithTheirTag) {
  auto bad = bus_is_open();
  bad.first_bad = BadReason::nak;
  EXPECT_TRUE(state.update(bad, 2000));
  EXPECT_EQ(state.update(bus_is_open(), 2100).value().status.state, State::online);
}

TEST(DeviceState, BroadcastIsOnlineWhileItsBusIsOpen) {
  DeviceState state(0, *codec_of("modbus-rtu", {{"unit", std::int64_t{0}}}), 1000);
  const auto open = state.update(bus_is_open(), 1100).value();
  EXPECT_EQ(open.status.state, State::online);
  EXPECT_EQ(open.status.reason, "");
  EXPECT_EQ(state.update({}, 1200).value().status.reason, "link_down");
}

TEST(DeviceState, ClosedBusIsTheFirstNewsEvenWhereNothingEverAnswered) {
  DeviceState state(0, *port_codec(), 1000);
  const auto change = state.update({}, 1100).value();
  EXPECT_TRUE(change.other_state) << "offline as before, and no longer starting";
  EXPECT_EQ(change.status.state, State::offline);
  EXPECT_EQ(change.status.reason, "link_down");
  EXPECT_EQ(change.status.since_ms, 1100);
  EXPECT_FALSE(state.update({}, 1200));
}

TEST(DeviceState, OtherReasonOfTheSameStateKeepsItsBeginning) {
  DeviceState state(0, *port_codec(), 1000);
  state.update({}, 1100);
  DeviceState::Facts facts;
  facts.never_silent = true;
  const auto change = state.update(facts, 1200).value();
  EXPECT_FALSE(change.other_state);
  EXPECT_EQ(change.status.reason, "never_silent");
  EXPECT_EQ(change.status.since_ms, 1100);
}

TEST(DeviceState, ReasonsHaveTheirOrder) {
  DeviceState state(0, *port_codec(fx::Model::unknown_fx), 1000);
  state.answered();
  state.set_model(std::nullopt);
  DeviceState::Facts facts{.silent = true, .first_bad = BadReason::nak};
  EXPECT_EQ(state.update(facts, 1100)->status.reason, "link_down");
  facts.bus_open = true;
  EXPECT_EQ(state.update(facts, 1100)->status.reason, "timeout");
  facts.silent = false;
  const auto unclear = state.update(facts, 1100);
  EXPECT_EQ(unclear->status.state, State::degraded);
  EXPECT_EQ(unclear->status.reason, "model_unknown");
  state.set_model("FX2N");
  const auto bad = state.update(facts, 1100);
  EXPECT_EQ(bad->status.state, State::degraded);
  EXPECT_EQ(bad->status.reason, "nak");
  EXPECT_EQ(bad->status.model, "FX2N");
}

TEST(DeviceState, ModelThatIsFoundWhileTheDeviceIsOnlineIsTold) {
  // A command was answered first, so the device is online before its model is requested.
  DeviceState state(0, *port_codec(fx::Model::unknown_fx), 1000);
  EXPECT_FALSE(state.is_model_known());
  state.answered();
  state.update(bus_is_open(), 1100);
  state.set_model("FX3U");
  EXPECT_TRUE(state.is_model_known());
  const auto change = state.update(bus_is_open(), 1200).value();
  EXPECT_FALSE(change.other_state);
  EXPECT_EQ(change.status.model, "FX3U");
}

TEST(DeviceState, SilenceForgetsTheRunStateAndAModelThatWasAsked) {
  DeviceState asked(0, *port_codec(fx::Model::unknown_fx), 1000);
  asked.answered();
  asked.set_model("FX3U");
  asked.set_run(true);
  EXPECT_EQ(asked.update(bus_is_open(), 1100)->status.run, true);
  asked.fell_silent();
  EXPECT_FALSE(asked.is_model_known());
  EXPECT_EQ(asked.update(bus_is_open(), 1200)->status.run, std::nullopt);

  DeviceState configured(0, *port_codec(), 1000);
  configured.fell_silent();
  EXPECT_TRUE(configured.is_model_known()) << "the config says which";
}

TEST(DeviceState, PlcOfAnotherModelThanTheConfigsIsOnlineAndSaysSo) {
  DeviceState state(0, *port_codec(), 1000);
  EXPECT_TRUE(state.must_compare_model());
  state.answered();
  EXPECT_EQ(state.update(bus_is_open(), 1100)->status.model_configured, "");
  state.set_model_of_plc("FX2N");
  EXPECT_FALSE(state.must_compare_model());
  const auto other = state.update(bus_is_open(), 1200).value();
  EXPECT_EQ(other.status.state, State::online);
  EXPECT_EQ(other.status.model, "FX2N");
  EXPECT_EQ(other.status.model_configured, "FX3U");
  EXPECT_NE(other.status.reason_text.find("the PLC is an FX2N, but the config says FX3U"),
            std::string::npos);
  state.fell_silent();
  EXPECT_TRUE(state.must_compare_model()) << "another PLC may answer next";
  state.set_model_of_plc("FX3U");
  EXPECT_EQ(state.update(bus_is_open(), 1300)->status.model_configured, "");
}

TEST(DeviceState, PlcThatNamesNoModelIsNotTheOtherModelThatWasThereBefore) {
  DeviceState state(0, *port_codec(), 1000);
  state.answered();
  state.set_model_of_plc("FX2N");
  EXPECT_EQ(state.update(bus_is_open(), 1100)->status.model_configured, "FX3U");
  state.fell_silent();
  state.set_model_of_plc(std::nullopt);
  EXPECT_EQ(state.update(bus_is_open(), 1200)->status.model_configured, "");
}

TEST(DeviceState, LostQuestionForTheModelIsRepeatedTwice) {
  DeviceState state(0, *port_codec(), 1000);
  for (int lost = 1; lost <= 3; ++lost) {
    EXPECT_TRUE(state.must_compare_model()) << lost;
    state.comparison_unanswered();
  }
  EXPECT_FALSE(state.must_compare_model());
  state.fell_silent();
  EXPECT_TRUE(state.must_compare_model()) << "another PLC may answer next";
}

TEST(DeviceState, PlcThatNamesNoModelIsNotAskedAgain) {
  DeviceState state(0, *port_codec(), 1000);
  state.set_model_of_plc(std::nullopt);
  state.fell_silent();
  EXPECT_FALSE(state.must_compare_model());
  EXPECT_FALSE(DeviceState(0, *port_codec(fx::Model::unknown_fx), 1000).must_compare_model());
  EXPECT_FALSE(DeviceState(0, *codec_of("modbus-rtu"), 1000).must_compare_model());
}

TEST_F(DeviceStateAnswered, RunStateIsNotToldOfAClosedBusAndIsBackAfterwards) {
  state.set_run(false);
  EXPECT_EQ(state.update(bus_is_open(), 1100)->status.run, false);
  EXPECT_EQ(state.update({}, 1200)->status.run, std::nullopt);
  EXPECT_EQ(state.update(bus_is_open(), 1300)->status.run, false);
}

}  // namespace
}  // namespace fxagent::test
