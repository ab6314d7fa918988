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

TEST(Config, NoTwoPlcsShareANameOrALine) {
  const auto two = [](const char* a, const char* b) {
    return error_of({{"plcs", json::array({json::parse(a), json::parse(b)})}});
  };
  EXPECT_EQ(two(R"({"name": "p", "tcp": 0})", R"({"name": "p", "tcp": 0})"),
            "/plcs/1/name: p is there twice");
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

}  // namespace
}  // namespace fxsim
