#include "tests/sim/control.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "tests/sim/modbus.h"
#include "tests/sim/programming_port.h"
#include "tests/sim/sample_plc.h"

namespace fxsim {
namespace {

using nlohmann::json;

class Control : public testing::Test {
 protected:
  json ask(const char* request) { return obey(json::parse(request), stations_, TimePoint{}); }

  Station station_{"p1", make_programming_port(), make_plc(), TimePoint{}, {}, {}};
  Stations stations_{{"p1", &station_}};
};

TEST_F(Control, WhatIsSetIsGot) {
  EXPECT_EQ(ask(R"({"cmd": "set", "plc": "p1", "device": "D100", "value": 5})"),
            json::parse(R"({"ok": true})"));
  EXPECT_EQ(ask(R"({"cmd": "set", "plc": "p1", "device": "D101", "value": [-1, 7]})")["ok"], true);
  EXPECT_EQ(ask(R"({"cmd": "get", "plc": "p1", "device": "D100", "count": 3})"),
            json::parse(R"({"ok": true, "values": [5, 65535, 7]})"));
  EXPECT_EQ(ask(R"({"cmd": "get", "plc": "p1", "device": "D101", "signed": true})")["values"],
            json::array({-1}));
}

TEST_F(Control, EveryDeviceHasAName) {
  for (const auto* name : {"X17", "Y377", "M0", "M8511", "S4095", "TS5", "TC5", "TN511", "CS199",
                           "CC255", "CN199", "CN200", "CN255", "D7999", "D8511"}) {
    SCOPED_TRACE(name);
    const json set = {{"cmd", "set"}, {"plc", "p1"}, {"device", name}, {"value", 1}};
    EXPECT_EQ(obey(set, stations_, TimePoint{})["ok"], true);
    const json get = {{"cmd", "get"}, {"plc", "p1"}, {"device", name}};
    EXPECT_EQ(obey(get, stations_, TimePoint{})["values"], json::array({1}));
    EXPECT_EQ(device_name(parse_device(name).value()), name);
  }
}

TEST_F(Control, NamesOfNoDeviceAreRefused) {
  for (const auto* name : {"X8", "X400", "D8512", "M7680", "T5", "C5", "TN512", "CN256", "D", "Q0",
                           "D-1", "D1 ", ""}) {
    SCOPED_TRACE(name);
    const json get = {{"cmd", "get"}, {"plc", "p1"}, {"device", name}};
    EXPECT_EQ(obey(get, stations_, TimePoint{})["ok"], false);
  }
}

TEST_F(Control, ErrorsAreAnswers) {
  for (const auto* request :
       {R"([])", R"({})", R"({"cmd": 5})", R"({"cmd": "get", "plc": "p9", "device": "D0"})",
        R"({"cmd": "dance", "plc": "p1"})", R"({"cmd": "get", "plc": "p1"})",
        R"({"cmd": "get", "plc": "p1", "device": "D0", "count": -1})",
        R"({"cmd": "get", "plc": "p1", "device": "D7999", "count": 2})",
        R"({"cmd": "get", "plc": "p1", "device": "D0", "signed": 3})",
        R"({"cmd": "set", "plc": "p1", "device": "D0", "value": "5"})",
        R"({"cmd": "set", "plc": "p1", "device": "M0", "value": 2})",
        R"({"cmd": "fault", "plc": "p1", "kind": "rust"})",
        R"({"cmd": "fault", "plc": "p1", "kind": "nak", "colour": 1})",
        R"({"cmd": "switch", "plc": "p1", "position": "left"})"}) {
    SCOPED_TRACE(request);
    const auto reply = ask(request);
    EXPECT_EQ(reply["ok"], false);
    EXPECT_FALSE(reply["error"].get<std::string>().empty());
  }
}

TEST_F(Control, FaultStrikesUntilCleared) {
  const Frame enquiry{{0x05}, true, {}};
  EXPECT_EQ(ask(R"({"cmd": "fault", "plc": "p1", "kind": "silent", "count": -1})")["ok"], true);
  EXPECT_TRUE(station_.answer(enquiry, TimePoint{}).pieces.empty());
  EXPECT_EQ(ask(R"({"cmd": "clear_faults", "plc": "p1"})")["ok"], true);
  EXPECT_EQ(station_.answer(enquiry, TimePoint{}).pieces.size(), 1U);
  ask(R"({"cmd": "fault", "plc": "p1", "kind": "silent", "count": -1})");
  EXPECT_EQ(ask(R"({"cmd": "clear_faults"})")["ok"], true);  // of all PLCs
  EXPECT_EQ(station_.answer(enquiry, TimePoint{}).pieces.size(), 1U);
}

TEST_F(Control, StatsAndLogTellWhatCame) {
  station_.answer({{0x05}, true, {}}, TimePoint{});
  station_.answer({*from_hex("02 37 36 34 30 38 03 30 43"), true, {}}, TimePoint{});  // M100 ON
  station_.answer({*from_hex("02 30 45 30 32 30 32 03 30 30"), true, {}}, TimePoint{});
  const auto stats = ask(R"({"cmd": "stats", "plc": "p1"})");
  EXPECT_EQ(stats["requests"]["enq"], 1);
  EXPECT_EQ(stats["requests"]["force_on"], 1);
  EXPECT_EQ(stats["requests"]["read"], 1);
  EXPECT_EQ(stats["naks"], 1);
  EXPECT_EQ(stats["accepted_writes"], 1);
  EXPECT_EQ(stats["accepted_reads"], 0);
  EXPECT_EQ(stats["bytes_in"], 20);
  EXPECT_EQ(ask(R"({"cmd": "log", "plc": "p1", "since": 1})")["log"],
            json::parse(R"([{"index": 1, "ms": 0, "kind": "force_on", "device": "M100",
                             "count": 1, "value": 1}])"));
}

TEST_F(Control, RunAndStopMoveTheStateAndTheSwitchHasTheLastWord) {
  EXPECT_EQ(ask(R"({"cmd": "stop", "plc": "p1"})")["run"], false);
  EXPECT_EQ(ask(R"({"cmd": "get", "plc": "p1", "device": "M8000", "count": 4})")["values"],
            json::array({0, 1, 0, 1}));
  EXPECT_EQ(ask(R"({"cmd": "run", "plc": "p1"})")["run"], true);
  EXPECT_EQ(ask(R"({"cmd": "switch", "plc": "p1", "position": "stop"})")["run"], false);
  EXPECT_EQ(ask(R"({"cmd": "run", "plc": "p1"})")["run"], false);
}

TEST(ControlOfModbus, TablesAreSetGotAndLogged) {
  Station station("m1", make_modbus(Protocol::modbus_tcp, {}),
                  Plc(modbus_model(), make_plant("none"), TimePoint{}), TimePoint{}, {}, {});
  const Stations stations{{"m1", &station}};
  const auto ask = [&stations](const char* request) {
    return obey(json::parse(request), stations, TimePoint{});
  };
  for (const auto* name : {"co:65535", "di:0", "hr:0", "ir:65535"}) {
    SCOPED_TRACE(name);
    EXPECT_EQ(obey({{"cmd", "set"}, {"plc", "m1"}, {"device", name}, {"value", 1}}, stations,
                   TimePoint{})["ok"],
              true);
    EXPECT_EQ(
        obey({{"cmd", "get"}, {"plc", "m1"}, {"device", name}}, stations, TimePoint{})["values"],
        json::array({1}));
  }
  station.answer({*from_hex("00 01 00 00 00 06 01 06 00 07 FF FF"), true, {}}, TimePoint{});
  EXPECT_EQ(ask(R"({"cmd": "get", "plc": "m1", "device": "hr:7", "signed": true})")["values"],
            json::array({-1}));
  const auto log = ask(R"({"cmd": "log", "plc": "m1"})")["log"];
  ASSERT_EQ(log.size(), 1U);
  EXPECT_EQ(log[0]["device"], "hr:7");
  EXPECT_EQ(log[0]["value"], 65535);
  EXPECT_EQ(ask(R"({"cmd": "fault", "plc": "m1", "kind": "wrong_id"})")["ok"], true);
  EXPECT_EQ(ask(R"({"cmd": "fault", "plc": "m1", "kind": "wrong_sum"})")["ok"], false);
  EXPECT_EQ(ask(R"({"cmd": "get", "plc": "m1", "device": "D0"})")["ok"], false);
}

}  // namespace
}  // namespace fxsim
