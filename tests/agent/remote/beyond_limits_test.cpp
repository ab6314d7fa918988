#include "agent/remote/beyond_limits.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "tests/agent/remote/remote_plant.h"

namespace fxagent {
namespace {

using namespace test;

/// What is said of the local plant with `changes`, JSON by pointer, set remotely.
std::string said_of(const json& local, const std::vector<std::pair<const char*, json>>& changes) {
  json wanted = local;
  for (const auto& [pointer, value] : changes) wanted[json::json_pointer(pointer)] = value;
  return listed(beyond_limits(good(local.dump()), good(wanted.dump())));
}

struct Case {
  const char* name;
  json remote_allow;
  std::vector<std::pair<const char*, json>> changes;
  const char* said;  ///< empty: it may
};

TEST(BeyondLimits, CommandsMayNeverTouchMore) {
  const json basic{"links", "devices"};
  const json tag = {{"name", "x"}, {"address", "D300"}, {"access", "read_write"}};
  const json setpoint = {{"name", "setpoint"}, {"address", "D200"}, {"access", "read_write"}};
  json limited = setpoint;
  limited["max"] = 100;
  json scaled = limited;
  scaled["scale"] = 0.5;
  json renamed = limited;
  renamed["name"] = "running_speed";
  for (
      const Case& each : std::vector<Case>{
          {"the same", basic, {}, ""},
          {"less", basic, {{"/devices/0/commands/allow", {"M100-M120"}}}, ""},
          {"none", basic, {{"/devices/0/commands/allow", json::array()}}, ""},
          {"more",
           basic,
           {{"/devices/0/commands/allow", {"M100-M200"}}},
           "press1: commands.allow with M100 to M200 is wider"},
          {"beside a device of that name",
           basic,
           {{"/devices/1/commands", {{"allow", {"M100"}}}}},
           "mixer: commands.allow with M100 is wider"},
          {"named",
           {"devices", "commands.allow: D300-D399"},
           {{"/devices/0/commands/allow", {"M100-M199", "D310"}}},
           ""},
          {"named for all",
           {"devices", "commands.allow: D300-D399"},
           {{"/devices/1/commands", {{"allow", {"D300-D399"}}}}},
           ""},
          {"beyond what is named",
           {"devices", "commands.allow: D300-D399"},
           {{"/devices/0/commands/allow", {"D300-D400"}}},
           "D300 to D400 is wider"},
          {"a tag that is new",
           basic,
           {{"/devices/0/tags/3", tag}},
           "under this name: it has no such tag"},
          {"a tag that is named",
           {"devices", "commands.allow: D300-D399"},
           {{"/devices/0/tags/3", tag}},
           ""},
          {"a tag that was read",
           basic,
           {{"/devices/0/tags/0/access", "read_write"}},
           "the tag temp may be written, and the local file lets no command write there: there its "
           "access is read"},
          {"a tag within allow",
           basic,
           {{"/devices/0/tags/3", {{"name", "x"}, {"address", "M150"}, {"access", "read_write"}}}},
           ""},
          {"the tag as it is", basic, {{"/devices/0/tags/2", limited}}, ""},
          {"without its limit",
           basic,
           {{"/devices/0/tags/2", setpoint}},
           "the tag setpoint may be written, and the local file lets no command write there in "
           "this "
           "way: another max\n"},
          {"with another scale", basic, {{"/devices/0/tags/2", scaled}}, "way: another scale\n"},
          {"with much that is another",
           basic,
           {{"/devices/0/tags/2",
             {{"name", "setpoint"},
              {"address", "D201"},
              {"type", "uint32"},
              {"access", "read_write"},
              {"min", 1},
              {"max", 200}}}},
           "way: another address, type, min, max\n"},
          {"on a device that is new",
           basic,
           {{"/devices/1/tags", json::array({limited})}},
           "mixer: the tag setpoint may be written, and the local file lets no command write there "
           "under this name"},
          {"on a device that is another one",
           basic,
           {{"/devices/0/name", "press2"}},
           "it has no device of this name with this protocol, these options and this port or host"},
          {"by another name", basic, {{"/devices/0/tags/2", renamed}}, "the tag running_speed"},
          {"run and stop",
           basic,
           {{"/devices/0/commands/allow_run_stop", true}},
           "allow_run_stop is set"},
          {"run and stop, named",
           {"devices", "commands.allow_run_stop"},
           {{"/devices/0/commands/allow_run_stop", true}},
           ""},
          {"longer expiry",
           basic,
           {{"/devices/0/commands/max_expiry_s", 7200}},
           "max_expiry_s is longer than the local file's 3600"},
          {"unverified", basic, {{"/devices/0/commands/verify", false}}, "verify is off"},
      }) {
    const std::string said = said_of(local_plant(each.remote_allow), each.changes);
    if (each.said[0] == '\0')
      EXPECT_EQ(said, "") << each.name;
    else
      EXPECT_NE(said.find(each.said), std::string::npos) << each.name << ": " << said;
  }
}

/// A name must not carry its rights to another machine.
TEST(BeyondLimits, RightsStayWithTheMachine) {
  for (const Case& each : std::vector<Case>{
           {"another port", {}, {{"/links/0/serial/path", "/dev/ttyUSB1"}}, "press1: "},
           {"another link", {}, {{"/devices/0/link", "gw1"}}, "press1: "},
           {"another model", {}, {{"/devices/0/model", "FX3G"}}, "press1: "},
           {"a new baud rate is the same machine", {}, {{"/links/0/serial/baud", 19200}}, ""},
           {"as is another order of links",
            {},
            {{"/links/0", local_plant()["links"][1]}, {"/links/1", local_plant()["links"][0]}},
            ""},
       }) {
    const std::string said = said_of(local_plant(), each.changes);
    if (each.said[0] == '\0')
      EXPECT_EQ(said, "") << each.name;
    else
      EXPECT_NE(said.find(each.said), std::string::npos) << each.name << ": " << said;
  }
  json bus = local_plant();
  bus["links"][1] = {{"name", "gw1"}, {"tcp", {{"host", "192.0.2.10"}, {"port", 502}}}};
  bus["devices"][1] = {{"name", "mixer"},
                       {"link", "gw1"},
                       {"protocol", "modbus-tcp"},
                       {"unit", 1},
                       {"commands", {{"allow", {"hr:0-hr:9"}}}}};
  EXPECT_EQ(said_of(bus, {{"/devices/1/retries", 3}}), "");
  EXPECT_NE(said_of(bus, {{"/devices/1/unit", 2}}), "");
  EXPECT_NE(said_of(bus, {{"/links/1/tcp/host", "192.0.2.11"}}), "");
  EXPECT_NE(said_of(bus, {{"/links/1/tcp/port", 503}}), "");
  EXPECT_NE(said_of(bus, {{"/devices/1/name", "mixer2"}}), "");
}

TEST(BeyondLimits, RightsStayWithTheMachineOverUdpToo) {
  json local = local_plant();
  local["links"][1] = {{"name", "gw1"}, {"udp", {{"host", "192.0.2.10"}, {"port", 5000}}}};
  local["devices"][1] = {{"name", "mixer"},
                         {"link", "gw1"},
                         {"protocol", "mc-3e"},
                         {"model", "FX5U"},
                         {"commands", {{"allow", {"D0-D9"}}}}};
  EXPECT_EQ(said_of(local, {{"/devices/1/retries", 3}}), "");
  EXPECT_EQ(said_of(local, {{"/links/1/udp/local_port", 5000}}), "");
  EXPECT_NE(said_of(local, {{"/links/1/udp/host", "192.0.2.11"}}), "");
  EXPECT_NE(said_of(local, {{"/links/1/udp/port", 503}}), "");
  const json tcp = {{"name", "gw1"}, {"tcp", local["links"][1]["udp"]}};
  EXPECT_NE(said_of(local, {{"/links/1", tcp}}), "");
}

/// Every unit obeys it, so that it would have rights on machines that have none.
TEST(BeyondLimits, NoNamedRangeIsForABroadcast) {
  json local = local_plant(json{"links", "devices", "commands.allow: hr:0-hr:9"});
  json wanted = local;
  wanted["links"].push_back({{"name", "bus"}, {"serial", {{"path", "/dev/ttyUSB5"}}}});
  wanted["devices"].push_back({{"name", "all"},
                               {"link", "bus"},
                               {"protocol", "modbus-rtu"},
                               {"unit", 0},
                               {"commands", {{"allow", {"hr:0-hr:9"}}}}});
  const auto said = [&] { return listed(beyond_limits(good(local.dump()), good(wanted.dump()))); };
  EXPECT_NE(said().find("all: commands.allow with hr:0 to hr:9 is wider"), std::string::npos)
      << said();
  wanted["devices"].back()["unit"] = 1;
  EXPECT_EQ(said(), "");
}

TEST(BeyondLimits, AModelThatIsStillToBeAskedHasTheWidestAddresses) {
  json local = local_plant(json{"devices", "commands.allow: D7000-D7999"});
  local["devices"][1].erase("model");
  EXPECT_EQ(said_of(local, {{"/devices/1/commands", {{"allow", {"D7000"}}}}}), "");
}

TEST(BeyondLimits, ThePasswordGoesToNoOtherServer) {
  json local = local_plant(json{"mqtt.servers"});
  EXPECT_EQ(said_of(local, {{"/mqtt/servers", local["mqtt"]["servers"]}}), "");
  for (const char* server : {"mqtt://192.0.2.66", "mqtts://192.0.2.66"})
    EXPECT_NE(said_of(local, {{"/mqtt/servers/0", server}}).find("the agent's password"),
              std::string::npos)
        << server;
  local["mqtt"]["tls"]["ca_file"] = "ca.pem";
  EXPECT_EQ(said_of(local, {{"/mqtt/servers/0", "mqtts://192.0.2.66"}}), "");
  EXPECT_NE(said_of(local, {{"/mqtt/servers/0", "mqtt://192.0.2.66"}}), "");
  for (const char* key : {"username", "password"}) local["mqtt"].erase(key);
  local["mqtt"].erase("tls");
  EXPECT_EQ(said_of(local, {{"/mqtt/servers/0", "mqtt://192.0.2.66"}}), "");
}

TEST(BeyondLimits, OnlySerialPortsAreOpened) {
  json local = local_plant();
  local["devices"][0]["commands"] = json::object();
  local["devices"][0]["tags"].erase(2);
  for (const char* path : {"/dev/ttyUSB7", "/dev/ttyS0", "/dev/ttyACM10", "/dev/ttymxc2",
                           "/dev/serial/by-id/usb-FTDI_A-if00-port0",
                           "/dev/serial/by-path/pci-0000:00:14.0-usb-0:1:1.0-port0"})
    EXPECT_EQ(said_of(local, {{"/links/0/serial/path", path}}), "") << path;
  for (const char* path :
       {"/dev/watchdog", "/dev/tty", "/dev/tty1", "/dev/sda", "/dev/ttyUSB", "/dev/ttyUSB0x",
        "/dev/serial/by-id/../../sda", "ttyUSB0", "/etc/shadow"})
    EXPECT_NE(said_of(local, {{"/links/0/serial/path", path}}).find("no name of a serial port"),
              std::string::npos)
        << path;
  local["links"][0]["serial"]["path"] = "/run/plc1";
  EXPECT_EQ(said_of(local, {{"/links/0/serial/path", "/run/plc1"}}), "");
}

}  // namespace
}  // namespace fxagent
