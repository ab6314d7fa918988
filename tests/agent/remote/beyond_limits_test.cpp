#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <string>
#include <string_view>
#include <utility>

#include "tests/agent/remote/remote_plant.h"
#include "tests/support/says.h"

namespace fxagent {
namespace {

using namespace test;

/// Returns the errors if `changes` (JSON by pointer) to the local plant are set remotely.
std::string said_of(const json& local, const json& changes) {
  json wanted = local;
  for (const auto& [pointer, value] : changes.items()) wanted[json::json_pointer(pointer)] = value;
  return listed(beyond_limits(good(local.dump()), good(wanted.dump())));
}

/// Each case of the table has a name, changes to the local plant, and parts of the error that they
/// must have; without any they are allowed.
void expect_limits(const json& local, const char* table) {
  const json cases = json::parse(table);
  for (const json& each : cases) {
    const std::string said = said_of(local, each[1]);
    EXPECT_EQ(said.empty(), each.size() == 2) << each[0] << ": " << said;
    for (std::size_t i = 2; i < each.size(); ++i)
      EXPECT_NE(said.find(each[i].get<std::string>()), std::string::npos)
          << each[0] << ": " << said;
  }
}

TEST(BeyondLimits, CommandsMayNeverTouchMore) {
  expect_limits(local_plant(json{"links", "devices"}), R"([
    ["the same", {}],
    ["less", {"/devices/0/commands/allow": ["M100-M120"]}],
    ["none", {"/devices/0/commands/allow": []}],
    ["more", {"/devices/0/commands/allow": ["M100-M200"]},
     "press1: commands.allow with M100 to M200 goes beyond"],
    ["beside a device of that name", {"/devices/1/commands": {"allow": ["M100"]}},
     "mixer: commands.allow with M100 goes beyond"],
    ["a tag that is new",
     {"/devices/0/tags/3": {"name": "x", "address": "D300", "access": "read_write"}},
     "under this name: it does not have this tag"],
    ["a tag that was read", {"/devices/0/tags/0/access": "read_write"},
     "the tag temp may be written, but the local file does not let commands write there: ",
     "let commands write there: its access there is read"],
    ["a tag within allow",
     {"/devices/0/tags/3": {"name": "x", "address": "M150", "access": "read_write"}}],
    ["the tag as it is", {"/devices/0/tags/2":
      {"name": "setpoint", "address": "D200", "access": "read_write", "max": 100}}],
    ["without its limit",
     {"/devices/0/tags/2": {"name": "setpoint", "address": "D200", "access": "read_write"}},
     "the tag setpoint may be written, but the local file does not let commands write there ",
     "let commands write there in this way: different max\n"],
    ["with another scale", {"/devices/0/tags/2":
      {"name": "setpoint", "address": "D200", "access": "read_write", "max": 100, "scale": 0.5}},
     "way: different scale\n"],
    ["with much that is another", {"/devices/0/tags/2":
      {"name": "setpoint", "address": "D201", "type": "uint32", "access": "read_write",
       "min": 1, "max": 200}},
     "way: different address, type, min, max\n"],
    ["on a device that is new", {"/devices/1/tags":
      [{"name": "setpoint", "address": "D200", "access": "read_write", "max": 100}]},
     "mixer: the tag setpoint may be written, but the local file does not let commands ",
     "does not let commands write there under this name"],
    ["on a device that is another one", {"/devices/0/name": "press2"},
     "let commands write there: the local file has no device of this name\n"],
    ["by another name", {"/devices/0/tags/2":
      {"name": "running_speed", "address": "D200", "access": "read_write", "max": 100}},
     "the tag running_speed"],
    ["run and stop", {"/devices/0/commands/allow_run_stop": true}, "allow_run_stop is set"],
    ["longer expiry", {"/devices/0/commands/max_expiry_s": 7200},
     "max_expiry_s is longer than the local file's 3600"],
    ["unverified", {"/devices/0/commands/verify": false}, "verify is off"]])");
  expect_limits(local_plant(json{"devices", "commands.allow: D300-D399"}), R"([
    ["named", {"/devices/0/commands/allow": ["M100-M199", "D310"]}],
    ["named for all", {"/devices/1/commands": {"allow": ["D300-D399"]}}],
    ["beyond what is named", {"/devices/0/commands/allow": ["D300-D400"]},
     "D300 to D400 goes beyond"],
    ["a tag that is named",
     {"/devices/0/tags/3": {"name": "x", "address": "D300", "access": "read_write"}}]])");
  expect_limits(local_plant(json{"devices", "commands.allow_run_stop"}), R"([
    ["run and stop, named", {"/devices/0/commands/allow_run_stop": true}]])");
}

/// A device name must not carry its rights to another machine.
TEST(BeyondLimits, RightsStayWithTheMachine) {
  expect_limits(local_plant(), R"([
    ["another port", {"/links/0/serial/path": "/dev/ttyUSB1"}, "press1: ",
     "and its remote_allow: the local file's device of this name has a different port or host\n",
     "let commands write there: the local file's device of this name has a different port or host\n"],
    ["another link", {"/devices/0/link": "gw1"}, "press1: "],
    ["another model", {"/devices/0/model": "FX3G"}, "press1: ", "a different model\n"],
    ["another protocol", {"/devices/0/protocol": "fx-computer-link"},
     "press1: ", "a different protocol\n"],
    ["other options", {"/devices/0/max_block_bytes": 32, "/devices/0/enquire": "never"},
     "a different enquire, max_block_bytes\n"],
    ["options of every protocol are the same machine",
     {"/devices/0/timeout_ms": 500, "/devices/0/retries": 7, "/devices/0/gap_ms": 5,
      "/devices/0/turnaround_ms": 5, "/devices/0/echo": true}],
    ["a new baud rate is the same machine", {"/links/0/serial/baud": 19200}]])");
  const json links = local_plant()["links"];
  EXPECT_EQ(said_of(local_plant(), {{"/links/0", links[1]}, {"/links/1", links[0]}}), "")
      << "another order of links is the same machine too";
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

/// Every unit obeys a broadcast, so it would give rights on machines that have none.
TEST(BeyondLimits, NoNamedRangeIsForABroadcast) {
  json local = local_plant(json{"links", "devices", "commands.allow: modbus-rtu hr:0-hr:9"});
  json wanted = local;
  wanted["links"].push_back({{"name", "bus"}, {"serial", {{"path", "/dev/ttyUSB5"}}}});
  wanted["devices"].push_back({{"name", "all"},
                               {"link", "bus"},
                               {"protocol", "modbus-rtu"},
                               {"unit", 0},
                               {"commands", {{"allow", {"hr:0-hr:9"}}}}});
  const auto said = [&] { return listed(beyond_limits(good(local.dump()), good(wanted.dump()))); };
  expect_says(said(), "all: commands.allow with hr:0 to hr:9 goes beyond");
  wanted["devices"].back()["unit"] = 1;
  EXPECT_EQ(said(), "");
}

/// Each device has its own link with its own name, because a link has one protocol.
json device(const char* name, const char* protocol, json options = json::object()) {
  json made = {{"name", name}, {"link", name}, {"protocol", protocol}};
  made.update(options);
  return made;
}

json allowing(json device, const json& ranges) {
  device["commands"]["allow"] = ranges;
  return device;
}

/// A local file whose `devices` no command may write. Remotely, devices may be added and `entry`,
/// the text after `commands.allow: `, may be written.
json plant_with(const std::string& entry, const std::vector<json>& devices) {
  json local = small_plant();
  local["agent"]["remote_config"] = true;
  local["agent"]["remote_allow"] = {"devices", "commands.allow: " + entry};
  local["links"] = json::array();
  int host = 10;
  for (const char* name : {"press", "saw", "meter", "new"})
    local["links"].push_back(
        {{"name", name}, {"tcp", {{"host", "192.0.2." + std::to_string(host++)}, {"port", 5000}}}});
  local["devices"] = devices;
  return local;
}

/// Returns the errors if `wanted` replaces the local device of the same name or is added.
std::string said_of_device(const json& local, const json& wanted) {
  json all = local;
  json& devices = all["devices"];
  const auto same = std::find_if(devices.begin(), devices.end(),
                                 [&](const json& each) { return each["name"] == wanted["name"]; });
  if (same == devices.end())
    devices.push_back(wanted);
  else
    *same = wanted;
  return listed(beyond_limits(good(local.dump()), good(all.dump())));
}

void expect_may(const json& local, const json& wanted) {
  EXPECT_EQ(said_of_device(local, wanted), "") << wanted;
}
void expect_may_not(const json& local, const json& wanted) {
  EXPECT_NE(said_of_device(local, wanted).find("goes beyond the local file"), std::string::npos)
      << wanted;
}

const json kFx3u = {{"model", "FX3U"}};
const json kQ = {{"model", "Q"}};

/// Y0-Y17 are 16 outputs of an FX3U but 24 of a Q.
TEST(BeyondLimits, ARangeOfRemoteAllowIsForDevicesOfTheLocalFile) {
  const json fx = device("press", "mc-1e", kFx3u);
  const json q = device("saw", "mc-1e", kQ);
  const json local = plant_with("Y0-Y17", {fx, q});
  expect_may(local, allowing(fx, {"Y0-Y17"}));
  expect_may(local, allowing(q, {"Y0-Y17"}));
  expect_may_not(local, allowing(fx, {"Y0-Y20"}));
  for (const char* name : {"press", "new"})
    for (const char* protocol : {"mc-1e", "mc-3e"})
      expect_may_not(local, allowing(device(name, protocol, kQ), {"Y0"}));
  expect_may_not(local, allowing(device("new", "mc-1e", kFx3u), {"Y0"}));
  expect_says(said_of_device(local, allowing(device("new", "mc-1e", kFx3u), {"Y0"})),
              "\"commands.allow: mc-1e FX3U RANGE\"");
}

TEST(BeyondLimits, AnEntryWithProtocolAndModelIsForNewDevicesToo) {
  const json fx = device("press", "mc-1e", kFx3u);
  const json local = plant_with("mc-1e FX3U Y0-Y17", {fx});
  expect_may(local, allowing(fx, {"Y0-Y17"}));
  expect_may(local, allowing(device("new", "mc-1e", kFx3u), {"Y0-Y17"}));
  expect_may_not(local, allowing(device("new", "mc-1e", kFx3u), {"Y0-Y20"}));
  expect_may_not(local, allowing(device("new", "mc-1e", kQ), {"Y0"}));
  expect_may_not(local, allowing(device("new", "mc-1e", {{"model", "FX3G"}}), {"Y0"}));
  expect_may_not(local, allowing(device("new", "mc-1e"), {"Y0"}));  // its model is unknown
  expect_may_not(local, allowing(device("new", "mc-3e", {{"model", "FX5U"}}), {"Y0"}));
}

/// The machine at that port is the one in the local file, whatever a document calls it.
TEST(BeyondLimits, AnotherModelAtALocalPlaceGetsNothing) {
  const json local = plant_with("mc-1e Q Y0-Y17", {device("press", "mc-1e", kFx3u)});
  json q = device("new", "mc-1e", kQ);
  expect_may(local, allowing(q, {"Y0-Y17"}));
  expect_may_not(local, allowing(device("press", "mc-1e", kQ), {"Y0"}));
  q["link"] = "press";
  json all = local;
  all["devices"] = json::array({allowing(q, {"Y0"})});
  EXPECT_NE(listed(beyond_limits(good(local.dump()), good(all.dump()))), "");
}

/// Returns the errors if a document adds an FX5U that may be written, at `kind` (tcp or udp) to
/// `host` and `port`. The local file has a Q at 192.0.2.10, or at `local_host`.
std::string said_of_fx5u(const char* kind, const std::string& host, int port,
                         const std::string& local_host = "192.0.2.10") {
  json local = plant_with("mc-3e FX5U Y0-Y17", {device("press", "mc-3e", kQ)});
  local["links"][0]["tcp"]["host"] = local_host;
  json wanted = local;
  wanted["links"].back() = {{"name", "new"}, {kind, {{"host", host}, {"port", port}}}};
  wanted["devices"].push_back(allowing(device("new", "mc-3e", {{"model", "FX5U"}}), {"Y0-Y17"}));
  return listed(beyond_limits(good(local.dump()), good(wanted.dump())));
}

/// A PLC answers on several ports, and over TCP and UDP.
TEST(BeyondLimits, AHostIsOneMachineOnEveryPortAndTransport) {
  EXPECT_EQ(said_of_fx5u("tcp", "192.0.2.11", 5000), "");
  EXPECT_EQ(said_of_fx5u("udp", "2001:db8::a", 5000), "");
  for (const char* host : {"192.0.2.10", "::ffff:192.0.2.10", "::FFFF:c000:20a"})
    for (const char* kind : {"tcp", "udp"})
      for (const int port : {5000, 5007})
        expect_says(said_of_fx5u(kind, host, port),
                    "Y0 to Y17 goes beyond the local file and its remote_allow: it may be the "
                    "machine of press, whose protocol, model or route");
  EXPECT_NE(said_of_fx5u("tcp", "2001:DB8:0:0::a", 5000, "2001:db8::a"), "");
  for (const char* own : {"127.0.0.2", "::1", "0.0.0.0", "::", "::ffff:127.0.0.1"})
    EXPECT_NE(said_of_fx5u("tcp", own, 5000, "127.0.0.1"), "") << own;
}

/// A name may stand for any address, and two names for the same one.
TEST(BeyondLimits, AHostNameMayBeEveryMachine) {
  for (const char* name : {"press.plant", "localhost", "fe80::1%eth0"}) {
    EXPECT_NE(said_of_fx5u("tcp", name, 5007), "") << name;
    EXPECT_NE(said_of_fx5u("tcp", "192.0.2.11", 5007, name), "") << name;
    EXPECT_NE(said_of_fx5u("tcp", "press2", 5007, name), "") << name;
  }
  const json local = plant_with("mc-1e Q Y0-Y17", {device("press", "mc-1e", kQ)});
  json wanted = local;
  wanted["links"].back()["tcp"]["host"] = "press2";
  wanted["devices"].push_back(allowing(device("new", "mc-1e", kQ), {"Y0-Y17"}));
  EXPECT_EQ(listed(beyond_limits(good(local.dump()), good(wanted.dump()))), "")
      << "every machine of the file is of this protocol and model";
}

/// Each port of the server leads to a line of its own.
TEST(BeyondLimits, ASerialServerHasAMachineAtEachPort) {
  json local = plant_with("fx-computer-link FX3U Y0-Y17",
                          {device("press", "fx-computer-link", {{"model", "FX3G"}})});
  const json fx = allowing(device("new", "fx-computer-link", kFx3u), {"Y0-Y17"});
  json& link = local["links"].back();
  link["tcp"] = {{"host", "192.0.2.10"}, {"port", 5001}};
  expect_may(local, fx);
  link["tcp"]["port"] = 5000;
  expect_may_not(local, fx);
  local["devices"][0] = device("press", "modbus-tcp");
  link["tcp"]["port"] = 5001;
  expect_may_not(local, fx);
}

/// A port in /dev/serial/by-id is also /dev/ttyUSB0.
TEST(BeyondLimits, ASerialPortHasSeveralNames) {
  json local = plant_with("fx-computer-link FX3U Y0-Y17",
                          {device("press", "fx-computer-link", {{"model", "FX3G"}})});
  const json fx = allowing(device("new", "fx-computer-link", kFx3u), {"Y0-Y17"});
  const auto put = [&local](std::size_t link, const char* path) {
    json& each = local["links"][link];
    each.erase("tcp");
    each["serial"]["path"] = path;
  };
  put(3, "/dev/ttyUSB1");
  expect_may(local, fx);
  put(0, "/dev/serial/by-id/usb-FTDI_A-if00-port0");
  expect_may_not(local, fx);
  put(3, "/dev/serial/by-id/usb-FTDI_B-if00-port0");
  expect_may(local, fx);
  const std::vector<std::pair<const char*, const char*>> perhaps_one{
      {"/dev/plc", "/dev/ttyUSB0"},
      {"/dev/serial0", "/dev/ttyAMA0"},
      {"/dev/ttyUSB0", "/dev/ttyPLC1"},
      {"/dev/serial/by-path/pci-0:usb-0:1:1.0-port0",
       "/dev/serial/by-path/pci-0:usbv2-0:1:1.0-port0"}};
  for (const auto& [file, document] : perhaps_one) {
    put(0, file);
    put(3, document);
    expect_may_not(local, fx);
  }
}

TEST(BeyondLimits, ADeviceBehindAPlcSaysNothingOfThatPlc) {
  const json fx5u = {{"model", "FX5U"}};
  json behind = device("press", "mc-3e", fx5u);
  json local = plant_with("mc-3e FX5U Y0-Y17", {behind});
  local["links"][3]["tcp"] = {{"host", "192.0.2.10"}, {"port", 5007}};
  json fresh = allowing(device("new", "mc-3e", fx5u), {"Y0-Y7"});
  expect_may(local, fresh);
  local["devices"][0]["network"] = 1;
  expect_may_not(local, fresh);
}

/// The PLC at the host would pass the writes on to one of another model.
TEST(BeyondLimits, ARouteToAnotherPlcGetsNothing) {
  const json fx5u = device("new", "mc-3e", {{"model", "FX5U"}});
  const json local = plant_with("mc-3e FX5U Y0-Y17", {});
  const auto with = [&fx5u](const char* key, const json& value) {
    json routed = fx5u;
    routed[key] = value;
    return allowing(routed, {"Y0-Y7"});
  };
  for (const auto& [key, value] :
       {std::pair{"network", 1}, {"pc", 1}, {"module_io", 992}, {"module_station", 1}}) {
    expect_may_not(local, with(key, value));
    expect_says(said_of_device(local, with(key, value)), key);
  }
  expect_may(local, with("network", 0));
  expect_may(local, with("code", "ascii"));
  expect_may(local, with("monitoring_timer_ms", 500));
  json routed = fx5u;  // the local file may lead there
  routed["network"] = 1;
  expect_may(plant_with("mc-3e FX5U Y0-Y17", {routed}), allowing(routed, {"Y0-Y17"}));
}

/// Every other option is none that leads to another PLC. Decide about a new one here.
TEST(BeyondLimits, OptionsOfNoRouteAreKnown) {
  const std::set<std::string_view> harmless{"acknowledge_data",
                                            "address_base",
                                            "allow_read_modify_write",
                                            "byte_order",
                                            "code",
                                            "command_set",
                                            "enquire",
                                            "format",
                                            "max_block_bytes",
                                            "max_gap",
                                            "max_read",
                                            "message_wait_ms",
                                            "monitoring_timer_ms",
                                            "station",
                                            "sum_check",
                                            "unit"};
  const std::set<std::string_view> route{"module_io", "module_station", "network", "pc"};
  for (const ProtocolInfo& protocol : catalog())
    for (const OptionSpec& spec : protocol.options)
      EXPECT_NE(harmless.contains(spec.key), route.contains(spec.key)) << spec.key;
}

TEST(BeyondLimits, ARegisterOfAnEntryIsTheSameByAnyAddressBase) {
  const json local = plant_with("modbus-tcp hr:300-hr:309", {device("meter", "modbus-tcp")});
  expect_may(local, allowing(device("new", "modbus-tcp", {{"unit", 7}}), {"hr:300-hr:309"}));
  const json from_one = {{"address_base", 1}};
  expect_may(local, allowing(device("new", "modbus-tcp", from_one), {"hr:301-hr:310"}));
  expect_may_not(local, allowing(device("new", "modbus-tcp", from_one), {"hr:300"}));
  // A plain range is interpreted by the local device, with its own base.
  const json own = plant_with("hr:300-hr:309", {device("meter", "modbus-tcp", from_one)});
  expect_may(own, allowing(device("meter", "modbus-tcp", from_one), {"hr:300-hr:309"}));
  expect_may_not(own, allowing(device("meter", "modbus-tcp"), {"hr:300"}));
}

TEST(BeyondLimits, AModelThatIsStillToBeAskedHasTheWidestAddresses) {
  json local = local_plant(json{"devices", "commands.allow: D7000-D7999"});
  local["devices"][1].erase("model");
  EXPECT_EQ(said_of(local, {{"/devices/1/commands", {{"allow", {"D7000"}}}}}), "");
}

/// A yield lets another program have the line.
TEST(BeyondLimits, OnlyTheLocalFileLetsALinkYield) {
  json local = local_plant();
  const std::string fault = "/links/0/allow_yield: is set, but the local file does not allow it";
  expect_says(said_of(local, {{"/links/0/allow_yield", true}}), fault);
  local["links"][0]["allow_yield"] = true;
  EXPECT_EQ(said_of(local, {{"/links/0/serial/baud", 19200}}), "");
  EXPECT_EQ(said_of(local, {{"/links/0/allow_yield", false}}), "");
  EXPECT_EQ(said_of(local, {{"/links/0/poll_share_percent", 0}}), "");
  expect_says(said_of(local, {{"/links/0/serial/path", "/dev/ttyUSB7"}}), fault);
  expect_says(said_of(local, {{"/links/1/allow_yield", true}}), "/links/1/allow_yield: is set");
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
    EXPECT_NE(
        said_of(local, {{"/links/0/serial/path", path}}).find("not the name of a serial port"),
        std::string::npos)
        << path;
  local["links"][0]["serial"]["path"] = "/run/plc1";
  EXPECT_EQ(said_of(local, {{"/links/0/serial/path", "/run/plc1"}}), "");
}

}  // namespace
}  // namespace fxagent
