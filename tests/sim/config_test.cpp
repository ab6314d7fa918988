#include "tests/sim/config.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace fxsim {
namespace {

using nlohmann::json;
using std::chrono::milliseconds;

json one(const char* plc) { return {{"plcs", json::array({json::parse(plc)})}}; }

std::string error_of(const json& root) {
  try {
    parse_config(root);
    return "no error";
  } catch (const ConfigError& error) {
    return error.what();
  }
}

TEST(Config, EveryKeyArrives) {
  const auto plcs = parse_config(one(R"({
    "name": "press1", "protocol": "fx-programming-port", "model": "FX2N", "pty": "/tmp/x/press1",
    "baud": 19200, "data_bits": 8, "parity": "none", "stop_bits": 2, "turnaround_ms": 12,
    "jitter_ms": 3, "seed": 9, "plant": "demo", "run": false, "run_switch": true,
    "memory": {"D100": -2, "X17": true, "CN200": [1, 2]},
    "faults": [{"kind": "late", "ms": 250, "match": "write", "count": -1, "every": 2,
                "probability": 0.5, "seed": 4}]})"));
  ASSERT_EQ(plcs.size(), 1U);
  const auto& plc = plcs[0];
  EXPECT_EQ(plc.name, "press1");
  EXPECT_EQ(plc.model->name, "FX2N");
  EXPECT_EQ(plc.line.pty, "/tmp/x/press1");
  EXPECT_EQ(plc.line.baud, 19200U);
  EXPECT_EQ(plc.line.bits_per_character, 11U);
  EXPECT_EQ(plc.response.turnaround, milliseconds(12));
  EXPECT_EQ(plc.response.jitter, milliseconds(3));
  EXPECT_EQ(plc.response.seed, 9U);
  EXPECT_EQ(plc.plant, "demo");
  EXPECT_FALSE(plc.run);
  EXPECT_TRUE(plc.run_switch);
  using Value = std::pair<Device, std::uint32_t>;
  EXPECT_EQ(plc.memory, (std::vector<Value>{{{Kind::c_value32, 0}, 1},
                                            {{Kind::c_value32, 1}, 2},
                                            {{Kind::d, 100}, 0xFFFE},
                                            {{Kind::x, 15}, 1}}));
  ASSERT_EQ(plc.faults.size(), 1U);
  EXPECT_EQ(plc.faults[0].kind, FaultKind::late);
  EXPECT_EQ(plc.faults[0].match, FaultMatch::write);
  EXPECT_EQ(plc.faults[0].count, -1);
  EXPECT_EQ(plc.faults[0].every, 2);
  EXPECT_EQ(plc.faults[0].probability, 0.5);
  EXPECT_EQ(plc.faults[0].seed, 4U);
  EXPECT_EQ(plc.faults[0].delay, milliseconds(250));
}

TEST(Config, LeftOutKeysAreAnFx3uAt9600Baud7E1) {
  const auto plcs = parse_config(one(R"({"name": "p", "tcp": 0})"));
  EXPECT_EQ(plcs[0].model->name, "FX3U");
  EXPECT_EQ(plcs[0].line.baud, 9600U);
  EXPECT_EQ(plcs[0].line.bits_per_character, 10U);
  EXPECT_EQ(plcs[0].plant, "none");
  EXPECT_TRUE(plcs[0].run);
}

TEST(Config, ErrorsNameTheKey) {
  struct Row {
    const char* plc;
    const char* place;
  };
  for (const auto& row : {
           Row{R"({"tcp": 0})", "/plcs/0/name:"},
           Row{R"({"name": "p"})", "/plcs/0:"},
           Row{R"({"name": "p", "tcp": 0, "pty": "/tmp/p"})", "/plcs/0:"},
           Row{R"({"name": "p", "tcp": 70000})", "/plcs/0/tcp:"},
           Row{R"({"name": "p", "pty": ""})", "/plcs/0/pty:"},
           Row{R"({"name": "p", "tcp": 0, "modell": "FX3U"})", "/plcs/0/modell:"},
           Row{R"({"name": "p", "tcp": 0, "model": "FX9"})", "/plcs/0/model:"},
           Row{R"({"name": "p", "tcp": 0, "protocol": "modbus"})", "/plcs/0/protocol:"},
           Row{R"({"name": "p", "tcp": 0, "baud": "fast"})", "/plcs/0/baud:"},
           Row{R"({"name": "p", "tcp": 0, "unit": 1})", "/plcs/0/unit:"},
           Row{R"({"name": "p", "tcp": 0, "with": "q"})", "/plcs/0/with:"},
           Row{R"({"name": "p", "tcp": 0, "repeat": 0})", "/plcs/0/repeat:"},
           Row{R"({"name": "p", "tcp": 0, "parity": "mark"})", "/plcs/0/parity:"},
           Row{R"({"name": "p", "tcp": 0, "plant": "mill"})", "/plcs/0/plant:"},
           Row{R"({"name": "p", "tcp": 0, "run": 1})", "/plcs/0/run:"},
           Row{R"({"name": "p", "tcp": 0, "memory": {"X8": 1}})", "/plcs/0/memory/X8:"},
           Row{R"({"name": "p", "tcp": 0, "memory": {"D8000": 65536}})", "/plcs/0/memory/D8000:"},
           Row{R"({"name": "p", "tcp": 0, "memory": {"D7999": [1, 2]}})", "/plcs/0/memory/D7999:"},
           Row{R"({"name": "p", "tcp": 0, "faults": [{}]})", "/plcs/0/faults/0/kind:"},
           Row{R"({"name": "p", "tcp": 0, "faults": [{"kind": "rust"}]})",
               "/plcs/0/faults/0/kind:"},
           Row{R"({"name": "p", "tcp": 0, "faults": [{"kind": "nak", "ms": 5}]})",
               "/plcs/0/faults/0/ms:"},
           Row{R"({"name": "p", "tcp": 0, "faults": [{"kind": "nak", "every": 0}]})",
               "/plcs/0/faults/0/every:"},
           Row{R"({"name": "p", "tcp": 0, "faults": [{"kind": "noise_after", "hex": "0"}]})",
               "/plcs/0/faults/0/hex:"},
       }) {
    const auto error = error_of(one(row.plc));
    EXPECT_TRUE(error.starts_with(row.place)) << row.plc << " gave " << error;
  }
}

std::string error_of_two(const char* a, const char* b) {
  return error_of({{"plcs", json::array({json::parse(a), json::parse(b)})}});
}

TEST(Config, ErrorsOfAProtocolNameTheKey) {
  struct Row {
    const char* protocol;
    const char* more;
    const char* place;
  };
  for (const auto& row : {
           Row{"fx-computer-link", R"({"station": 16})", "/plcs/0/station:"},
           Row{"fx-computer-link", R"({"format": 3})", "/plcs/0/format:"},
           Row{"fx-computer-link", R"({"unit": 3})", "/plcs/0/unit:"},
           Row{"fx-computer-link", R"({"gateway": true})", "/plcs/0/gateway:"},
           Row{"modbus-rtu", R"({"unit": 0})", "/plcs/0/unit:"},
           Row{"modbus-rtu", R"({"unit": 248})", "/plcs/0/unit:"},
           Row{"modbus-rtu", R"({"data_bits": 7})", "/plcs/0/data_bits:"},
           Row{"modbus-rtu", R"({"gateway": true})", "/plcs/0/gateway:"},
           Row{"modbus-tcp", R"({"unit": 256})", "/plcs/0/unit:"},
           Row{"modbus-tcp", R"({"model": "FX3U"})", "/plcs/0/model:"},
           Row{"modbus-tcp", R"({"plant": "demo"})", "/plcs/0/plant:"},
           Row{"modbus-tcp", R"({"memory": {"D0": 1}})", "/plcs/0/memory/D0:"},
           Row{"modbus-tcp", R"({"memory": {"hr:65536": 1}})", "/plcs/0/memory/hr:65536:"},
           Row{"modbus-tcp", R"({"memory": {"co:0": 2}})", "/plcs/0/memory/co:0:"},
           Row{"modbus-tcp", R"({"max_read": 126})", "/plcs/0/max_read:"},
           Row{"modbus-tcp", R"({"identity": [7]})", "/plcs/0/identity:"},
           Row{"modbus-tcp", R"({"identity": ["a", "b", "c", "d"]})", "/plcs/0/identity:"},
           Row{"modbus-tcp", R"({"holes": ["hr:5-hr:4"]})", "/plcs/0/holes/0:"},
           Row{"modbus-tcp", R"({"holes": ["hr:5-ir:6"]})", "/plcs/0/holes/0:"},
           Row{"modbus-tcp", R"({"missing_functions": [-1]})", "/plcs/0/missing_functions:"},
           Row{"modbus-tcp", R"({"faults": [{"kind": "wrong_sum"}]})", "/plcs/0/faults/0/kind:"},
           Row{"modbus-rtu", R"({"faults": [{"kind": "wrong_id"}]})", "/plcs/0/faults/0/kind:"},
           Row{"fx-computer-link", R"({"faults": [{"kind": "exception"}]})",
               "/plcs/0/faults/0/kind:"},
           Row{"fx-computer-link", R"({"faults": [{"kind": "nak", "code": "1"}]})",
               "/plcs/0/faults/0/code:"},
           Row{"fx-programming-port", R"({"faults": [{"kind": "nak", "code": 1}]})",
               "/plcs/0/faults/0/code:"},
           Row{"modbus-rtu", R"({"faults": [{"kind": "late", "code": 1}]})",
               "/plcs/0/faults/0/code:"},
           Row{"modbus-rtu", R"({"faults": [{"kind": "late", "match": "reads"}]})",
               "/plcs/0/faults/0/match:"},
           Row{"mc-3e", R"({"model": "FX3U"})", "/plcs/0/model:"},
           Row{"mc-1e", R"({"model": "FX5U"})", "/plcs/0/model:"},
           Row{"mc-1e", R"({"model": "FX2N"})", "/plcs/0/model:"},
           Row{"mc-3e", R"({"code": "hex"})", "/plcs/0/code:"},
           Row{"mc-3e", R"({"pc": 256})", "/plcs/0/pc:"},
           Row{"mc-3e", R"({"format": 1})", "/plcs/0/format:"},
           Row{"mc-3e", R"({"udp": 5000})", "/plcs/0:"},
           Row{"mc-3e", R"({"udp_peer_port": 5000})", "/plcs/0/udp_peer_port:"},
           Row{"mc-3e", R"({"wrong_route": "lost"})", "/plcs/0/wrong_route:"},
           Row{"mc-3e", R"({"memory": {"X8": 1}})", "/plcs/0/memory/X8:"},
           Row{"mc-3e", R"({"model": "Q", "plant": "demo"})", "/plcs/0/plant:"},
           Row{"mc-3c", R"({"format": 5})", "/plcs/0/format:"},
           Row{"mc-4c", R"({"format": 0})", "/plcs/0/format:"},
           Row{"mc-4c", R"({"code": "ascii"})", "/plcs/0/code:"},
           Row{"modbus-tcp", R"({"udp": 5000})", "/plcs/0/udp:"},
           Row{"mc-3e", R"({"faults": [{"kind": "wrong_id"}]})", "/plcs/0/faults/0/kind:"},
           Row{"mc-1e", R"({"faults": [{"kind": "wrong_station"}]})", "/plcs/0/faults/0/kind:"},
           Row{"mc-3c", R"({"faults": [{"kind": "bad_length"}]})", "/plcs/0/faults/0/kind:"},
           Row{"modbus-tcp", R"({"faults": [{"kind": "longer"}]})", "/plcs/0/faults/0/kind:"},
           Row{"mc-3e", R"({"faults": [{"kind": "nak", "code": "56"}]})", "/plcs/0/faults/0/code:"},
       }) {
    json plc = {{"name", "p"}, {"tcp", 0}, {"protocol", row.protocol}};
    plc.update(json::parse(row.more));
    const auto error = error_of({{"plcs", json::array({plc})}});
    EXPECT_TRUE(error.starts_with(row.place)) << plc << " gave " << error;
  }
  EXPECT_TRUE(error_of(one(R"({"name": "p", "pty": "/tmp/p", "protocol": "modbus-tcp"})"))
                  .starts_with("/plcs/0/pty:"));
}

TEST(Config, KeysOfComputerLinkAndModbusArrive) {
  const auto plcs = parse_config(json::parse(R"({"plcs": [
    {"name": "l", "protocol": "fx-computer-link", "tcp": 0, "station": 15, "format": 4,
     "sum_check": false, "memory": {"R100": 7},
     "faults": [{"kind": "nak", "code": "18", "match": "control"}]},
    {"name": "m", "protocol": "modbus-rtu", "tcp": 0, "unit": 247, "max_read": 60,
     "max_read_code": 2, "missing_functions": [6, 22], "holes": ["hr:100-hr:119", "co:7"],
     "memory": {"hr:5": [-1, 2], "di:0": true},
     "faults": [{"kind": "exception", "code": 6, "count": -1}]},
    {"name": "t", "protocol": "modbus-tcp", "tcp": 0, "unit": 0, "gateway": true}]})"));
  EXPECT_EQ(plcs[0].protocol, Protocol::computer_link);
  EXPECT_EQ(plcs[0].line.baud, 9600U);
  EXPECT_EQ(plcs[0].line.bits_per_character, 10U);
  EXPECT_EQ(plcs[0].computer_link.station, 15U);
  EXPECT_EQ(plcs[0].computer_link.format, 4U);
  EXPECT_FALSE(plcs[0].computer_link.sum_check);
  EXPECT_EQ(plcs[0].faults[0].code, 0x18);
  EXPECT_EQ(plcs[0].faults[0].match, FaultMatch::control);
  EXPECT_EQ(plcs[1].line.bits_per_character, 11U);
  EXPECT_EQ(plcs[1].modbus.unit, 247U);
  EXPECT_EQ(plcs[1].modbus.max_read, 60U);
  EXPECT_EQ(plcs[1].modbus.max_read_code, 2U);
  EXPECT_EQ(plcs[1].modbus.missing_functions, (std::vector<unsigned>{6, 22}));
  ASSERT_EQ(plcs[1].modbus.holes.size(), 2U);
  EXPECT_EQ(plcs[1].modbus.holes[0].range.last, 119U);
  EXPECT_EQ(plcs[1].modbus.holes[1].kind, Kind::coil);
  EXPECT_EQ(plcs[1].modbus.holes[1].range.last, 7U);
  using Value = std::pair<Device, std::uint32_t>;
  EXPECT_EQ(plcs[1].memory, (std::vector<Value>{{{Kind::discrete_input, 0}, 1},
                                                {{Kind::holding_register, 5}, 0xFFFF},
                                                {{Kind::holding_register, 6}, 2}}));
  EXPECT_EQ(plcs[1].faults[0].code, 6);
  EXPECT_EQ(plcs[2].line.baud, 0U);
  EXPECT_EQ(plcs[2].response.turnaround, milliseconds(0));
  EXPECT_TRUE(plcs[2].line.gateway);
}

TEST(Config, KeysOfTheMcProtocolArrive) {
  const auto plcs = parse_config(json::parse(R"({"plcs": [
    {"name": "e", "protocol": "mc-3e", "tcp": 0},
    {"name": "u", "protocol": "mc-4e", "model": "iQ-R", "udp": 0, "udp_peer_port": 5002,
     "code": "ascii", "network": 1, "pc": 2, "module_io": 992, "module_station": 3,
     "wrong_route": "silent", "write_in_run": false, "holes": ["X10-X1F"], "type_name": "R08CPU",
     "memory": {"X1F": true, "LTN5": 70000},
     "faults": [{"kind": "nak", "code": "C056"}, {"kind": "wrong_id"}, {"kind": "from_elsewhere"}]},
    {"name": "a", "protocol": "mc-1e", "tcp": 0, "connections": 1,
     "faults": [{"kind": "nak", "code": "5B12"}, {"kind": "nak", "code": "56"}]},
    {"name": "s", "protocol": "mc-4c", "tcp": 0, "station": 31, "format": 5,
     "sum_check": false}]})"));
  EXPECT_EQ(plcs[0].model->name, "FX5U");
  EXPECT_EQ(plcs[0].mc.family, Family::iq_f);
  EXPECT_EQ(plcs[0].mc.code, McCode::binary);
  EXPECT_EQ(plcs[0].line.connections, 0U);
  EXPECT_EQ(plcs[0].line.baud, 0U);
  EXPECT_EQ(plcs[1].line.udp, 0);
  EXPECT_EQ(plcs[1].line.udp_peer_port, 5002);
  EXPECT_EQ(plcs[1].mc.code, McCode::ascii);
  EXPECT_EQ(plcs[1].mc.route, (McRoute{1, 2, 992, 3}));
  EXPECT_FALSE(plcs[1].mc.refuses_foreign);
  EXPECT_FALSE(plcs[1].mc.cpu.write_in_run);
  EXPECT_EQ(plcs[1].mc.cpu.holes.at(0).kind, Kind::hex_x);
  EXPECT_EQ(plcs[1].mc.cpu.holes.at(0).range.last, 0x1FU);
  EXPECT_EQ(plcs[1].mc.cpu.type_name, "R08CPU");
  EXPECT_EQ(plcs[1].memory.at(1).first, (Device{Kind::hex_x, 0x1F}));
  EXPECT_EQ(plcs[1].faults.at(0).code, 0xC056);
  EXPECT_EQ(plcs[2].model->name, "FX3U");
  EXPECT_EQ(plcs[2].line.connections, 1U);
  EXPECT_EQ(plcs[2].faults.at(0).code, 0x5B12);
  EXPECT_EQ(plcs[2].faults.at(1).code, 0x56);
  EXPECT_EQ(plcs[3].line.baud, 9600U);
  EXPECT_EQ(plcs[3].line.bits_per_character, 11U);
  EXPECT_EQ(plcs[3].mc.station, 31U);
  EXPECT_EQ(plcs[3].mc.format, 5U);
  EXPECT_FALSE(plcs[3].mc.sum_check);
}

TEST(Config, McStationsOfOnePortDifferInTheirRoute) {
  constexpr auto kFirst = R"({"name": "p", "protocol": "mc-3e", "udp": 5000})";
  EXPECT_EQ(error_of_two(kFirst, R"({"name": "q", "protocol": "mc-3e", "udp": 5000})"),
            "/plcs/1: q is on the line of p, must have a network or pc of its own");
  EXPECT_EQ(error_of_two(kFirst, R"({"name": "q", "protocol": "mc-3e", "tcp": 5000})"), "no error");
  const auto plcs = parse_config(json::parse(R"({"plcs": [
    {"name": "p", "protocol": "mc-3e", "udp": 0},
    {"name": "q", "with": "p", "network": 1, "pc": 2}]})"));
  EXPECT_EQ(plcs[1].line_of, 0U);
  EXPECT_TRUE(plcs[0].mc.refuses_foreign);
  EXPECT_EQ(plcs[0].mc.neighbours.size(), 1U);
  EXPECT_FALSE(plcs[1].mc.refuses_foreign);
}

TEST(Config, StationsOfALineAgreeAndDiffer) {
  constexpr auto kFirst =
      R"({"name": "p", "protocol": "fx-computer-link", "pty": "/tmp/a", "station": 1})";
  struct Row {
    const char* more;
    const char* what;
  };
  for (const auto& row : {
           Row{R"({"station": 2})", "no error"},
           Row{R"({"station": 1})", "must have a station of its own"},
           Row{R"({"station": 2, "baud": 19200})", "must have its baud"},
           Row{R"({"station": 2, "data_bits": 8})",
               "must have its data_bits, parity and stop_bits"},
           Row{R"({"station": 2, "format": 4})", "must have its format"},
           Row{R"({"station": 2, "sum_check": false})", "must have its sum_check"},
           Row{R"({"protocol": "modbus-rtu"})", "must speak its protocol"},
       }) {
    json second = {{"name", "q"}, {"protocol", "fx-computer-link"}, {"pty", "/tmp/a"}};
    second.update(json::parse(row.more));
    const auto error = error_of_two(kFirst, second.dump().c_str());
    EXPECT_TRUE(error.ends_with(row.what)) << error;
  }
  EXPECT_TRUE(
      error_of_two(R"({"name": "p", "protocol": "modbus-tcp", "tcp": 5551, "gateway": true})",
                   R"({"name": "q", "protocol": "modbus-tcp", "tcp": 5551, "unit": 2})")
          .ends_with("must have its gateway"));
}

TEST(Config, WithTakesOverTheLineOfAnEarlierPlc) {
  const auto plcs = parse_config(json::parse(R"({"plcs": [
    {"name": "a", "protocol": "modbus-rtu", "tcp": 0, "baud": 19200, "parity": "none"},
    {"name": "b", "protocol": "modbus-rtu", "tcp": 0},
    {"name": "c", "with": "a", "unit": 2, "turnaround_ms": 50}]})"));
  EXPECT_EQ(plcs[0].line_of, 0U);
  EXPECT_EQ(plcs[1].line_of, 1U);
  EXPECT_EQ(plcs[2].line_of, 0U);
  EXPECT_EQ(plcs[2].protocol, Protocol::modbus_rtu);
  EXPECT_EQ(plcs[2].line.baud, 19200U);
  EXPECT_EQ(plcs[2].response.turnaround, milliseconds(50));
  EXPECT_TRUE(error_of_two(R"({"name": "a", "protocol": "modbus-rtu", "pty": "/tmp/a"})",
                           R"({"name": "b", "with": "a", "unit": 2, "pty": "/tmp/b"})")
                  .starts_with("/plcs/1/with:"));
}

TEST(Config, RepeatCountsPortsOrAddresses) {
  const auto ports = parse_config(
      one(R"({"repeat": 3, "name": "d{}", "protocol": "modbus-tcp", "tcp": 20000, "unit": 7})"));
  ASSERT_EQ(ports.size(), 3U);
  EXPECT_EQ(ports[2].name, "d2");
  EXPECT_EQ(ports[2].line.tcp, 20002U);
  EXPECT_EQ(ports[2].modbus.unit, 7U);
  const auto bus = parse_config(one(R"({"repeat": 4, "name": "st{}", "pty": "/tmp/bus",
      "protocol": "fx-computer-link", "station": 2})"));
  EXPECT_EQ(bus[3].computer_link.station, 5U);
  EXPECT_EQ(bus[3].line_of, 0U);
  const auto lines = parse_config(one(R"({"repeat": 2, "name": "p{}", "pty": "/tmp/p{}"})"));
  EXPECT_EQ(lines[1].line.pty, "/tmp/p1");
  const auto units = parse_config(json::parse(R"({"plcs": [
    {"name": "gw", "protocol": "modbus-tcp", "tcp": 0, "gateway": true},
    {"repeat": 3, "name": "u{}", "with": "gw", "unit": 2}]})"));
  EXPECT_EQ(units[3].modbus.unit, 4U);
  EXPECT_TRUE(units[3].line.gateway);
  EXPECT_TRUE(error_of(one(R"({"repeat": 2, "name": "p", "tcp": 0})"))
                  .starts_with("/plcs/0/name: p occurs twice"));
}

TEST(Config, NoTwoPlcsShareANameOrALineWithoutAddresses) {
  const auto two = error_of_two;
  EXPECT_EQ(two(R"({"name": "p", "tcp": 0})", R"({"name": "p", "tcp": 0})"),
            "/plcs/1/name: p occurs twice");
  EXPECT_EQ(two(R"({"name": "p", "pty": "/tmp/a"})", R"({"name": "q", "pty": "/tmp/a"})"),
            "/plcs/1: q is on the line of p, but this protocol has no addresses");
  EXPECT_EQ(two(R"({"name": "p", "tcp": 5551})", R"({"name": "q", "tcp": 5551})"),
            "/plcs/1: q is on the line of p, but this protocol has no addresses");
  EXPECT_EQ(two(R"({"name": "p", "tcp": 0})", R"({"name": "q", "tcp": 0})"), "no error");
}

TEST(Config, ShortFormIsTheSameObject) {
  EXPECT_EQ(plc_from_short_form("name=1,model=FX3U,pty=/tmp/x/p,baud=9600,run=false"),
            json::parse(R"({"name": "1", "model": "FX3U", "pty": "/tmp/x/p", "baud": 9600,
                            "run": false})"));
  EXPECT_THROW(plc_from_short_form("name=p,fast"), ConfigError);
}

TEST(Config, ARecordingIsPlayedOnEveryKindOfLine) {
  Recording recording;
  recording.link = "line1";
  recording.wire = "udp 10.0.0.7:5007";
  EXPECT_EQ(recorded_plc(recording, "udp=5008").line.udp, 5008);
  EXPECT_EQ(recorded_plc(recording, "").line.udp, 0);
  EXPECT_EQ(recorded_plc(recording, "tcp=5007").line.tcp, 5007);
  const auto plc = recorded_plc(recording, "pty=/tmp/x");
  EXPECT_EQ(plc.line.pty, "/tmp/x");
  EXPECT_EQ(plc.name, "line1");
  EXPECT_EQ(plc.response.turnaround, milliseconds(0));
  ASSERT_NE(plc.recording, nullptr);
  recording.wire = "serial /dev/x 9600 7E1";
  EXPECT_THROW(recorded_plc(recording, ""), ConfigError);
}

}  // namespace
}  // namespace fxsim
