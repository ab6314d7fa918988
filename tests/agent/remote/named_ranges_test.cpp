#include "agent/remote/named_ranges.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "agent/remote/beyond_limits.h"
#include "tests/agent/remote/remote_plant.h"

namespace fxagent {
namespace {

using namespace test;

/// Each on a link of its own, which has its name: one link speaks one protocol.
json device(const char* name, const char* protocol, json options = json::object()) {
  json made = {{"name", name}, {"link", name}, {"protocol", protocol}};
  made.update(options);
  return made;
}

json allowing(json device, const json& ranges) {
  device["commands"]["allow"] = ranges;
  return device;
}

/// A local file with these devices, none of which commands may touch; remotely devices may come,
/// and `range` be written.
json plant(const std::string& range, const std::vector<json>& devices) {
  json local = small_plant();
  local["agent"]["remote_config"] = true;
  local["agent"]["remote_allow"] = {"devices", "commands.allow: " + range};
  local["links"] = json::array();
  int port = 5000;
  for (const char* name :
       {"press", "saw", "meter", "m0", "m1", "m2", "small", "large", "another", "new"})
    local["links"].push_back({{"name", name}, {"tcp", {{"host", "192.0.2.10"}, {"port", port++}}}});
  local["devices"] = devices;
  return local;
}

std::string said_of(const json& local, const json& wanted_device) {
  json wanted = local;
  json& devices = wanted["devices"];
  const auto same = std::find_if(devices.begin(), devices.end(), [&](const json& each) {
    return each["name"] == wanted_device["name"];
  });
  if (same == devices.end())
    devices.push_back(wanted_device);
  else
    *same = wanted_device;
  return listed(beyond_limits(good(local.dump()), good(wanted.dump())));
}

void expect_may(const json& local, const json& wanted) {
  EXPECT_EQ(said_of(local, wanted), "") << wanted;
}
void expect_may_not(const json& local, const json& wanted) {
  EXPECT_NE(said_of(local, wanted).find("is wider than the local file"), std::string::npos)
      << wanted;
}

const json kFx3u = {{"model", "FX3U"}};
const json kQ = {{"model", "Q"}};
const json kFx5u = {{"model", "FX5U"}};

/// Y0-Y17 are 16 outputs of an FX3U. As those of a Q they would be Y0 to Y27 of that same FX3U.
TEST(NamedRanges, AnotherModelDoesNotMakeOutputsMore) {
  const json local = plant("Y0-Y17", {device("press", "mc-1e", kFx3u)});
  expect_may(local, allowing(device("press", "mc-1e", kFx3u), {"Y0-Y17"}));
  expect_may_not(local, allowing(device("press", "mc-1e", kFx3u), {"Y0-Y20"}));
  for (const char* name : {"press", "another"}) {
    for (const char* protocol : {"mc-1e", "mc-3e", "mc-4e"}) {
      expect_may_not(local, allowing(device(name, protocol, kQ), {"Y0-Y17"}));
      expect_may_not(local, allowing(device(name, protocol, kQ), {"Y17"}));
      expect_may(local, allowing(device(name, protocol, kQ), {"Y0-YF"}));
    }
    expect_may(local, allowing(device(name, "mc-3e", kFx5u), {"Y0-Y17"}));
    expect_may(local, allowing(device(name, "mc-1e", {{"model", "FX3G"}}), {"Y0-Y17"}));
    expect_may(local, allowing(device(name, "mc-1e", {{"model", "auto"}}), {"Y0-Y17"}));
  }
}

/// Nor does a route, which the PLC may understand as itself.
TEST(NamedRanges, AnotherRouteDoesNotMakeOutputsMore) {
  const json local = plant("Y0-Y17", {device("press", "mc-3e", kFx5u)});
  for (const auto& [key, value] : std::vector<std::pair<const char*, int>>{
           {"network", 1}, {"pc", 1}, {"module_io", 992}, {"module_station", 1}}) {
    json options = kQ;
    options[key] = value;
    expect_may_not(local, allowing(device("press", "mc-3e", options), {"Y0-Y17"}));
    expect_may_not(local, allowing(device("another", "mc-4e", options), {"Y10"}));
    options["model"] = "FX5U";
    expect_may(local, allowing(device("another", "mc-4e", options), {"Y0-Y17"}));
  }
}

TEST(NamedRanges, ARegisterIsThatOfTheLocalAddressBase) {
  const json local = plant("hr:300-hr:309", {device("meter", "modbus-tcp")});
  expect_may(local, allowing(device("another", "modbus-tcp", {{"unit", 7}}), {"hr:300-hr:309"}));
  for (const char* protocol : {"modbus-tcp", "modbus-rtu", "modbus-ascii"}) {
    expect_may_not(local, allowing(device("m2", protocol, {{"address_base", 1}}), {"hr:300"}));
    expect_may_not(local,
                   allowing(device("m2", protocol, {{"address_base", 1}}), {"hr:300-hr:309"}));
    expect_may(local, allowing(device("m2", protocol, {{"address_base", 1}}), {"hr:301-hr:309"}));
  }
  const json from_one =
      plant("hr:300-hr:309", {device("meter", "modbus-tcp", {{"address_base", 1}})});
  expect_may(from_one,
             allowing(device("m2", "modbus-tcp", {{"address_base", 1}}), {"hr:300-hr:309"}));
  expect_may_not(from_one, allowing(device("m2", "modbus-tcp"), {"hr:309"}));
  expect_may(from_one, allowing(device("m2", "modbus-tcp"), {"hr:300-hr:308"}));
}

/// 40301 is the same register whatever the base is.
TEST(NamedRanges, ANumberWithItsTableHasNoBase) {
  const json local = plant("40301-40310", {device("meter", "modbus-tcp")});
  expect_may(local, allowing(device("m2", "modbus-tcp", {{"address_base", 1}}), {"hr:301-hr:310"}));
}

TEST(NamedRanges, ADeviceOfTheLocalFileReadsThemItself) {
  json fx = device("press", "mc-1e", kFx3u);
  json q = device("saw", "mc-1e", kQ);
  json base = device("m1", "modbus-tcp", {{"address_base", 1}});
  const json outputs = plant("Y0-Y17", {fx, q});
  expect_may(outputs, allowing(fx, {"Y0-Y17"}));
  expect_may(outputs, allowing(q, {"Y0-Y17"}));
  // Another may be either of them.
  expect_may_not(outputs, allowing(device("new", "mc-1e", kQ), {"Y0-Y17"}));
  expect_may(outputs, allowing(device("new", "mc-1e", kQ), {"Y0-YF"}));
  expect_may(outputs, allowing(device("new", "mc-1e", kFx3u), {"Y0-Y17"}));
  const json registers = plant("hr:300-hr:309", {device("m0", "modbus-tcp"), base});
  expect_may(registers, allowing(base, {"hr:300-hr:309"}));
  expect_may_not(registers, allowing(device("new", "modbus-tcp"), {"hr:309"}));
  expect_may(registers, allowing(device("new", "modbus-tcp"), {"hr:300-hr:308"}));
}

/// M8034 switches off all outputs of an FX3U. It is never written there, and would be an ordinary
/// M of a Q.
TEST(NamedRanges, WhatAMachineNeverLetsBeWrittenStaysSo) {
  const json local =
      plant("M0-M8191", {device("press", "mc-1e", kFx3u), device("saw", "mc-3e", kQ)});
  expect_may_not(local, allowing(device("new", "mc-1e", kQ), {"M8034"}));
  expect_may_not(local, allowing(device("new", "mc-3e", kQ), {"M8034"}));
  expect_may(local, allowing(device("saw", "mc-3e", kQ), {"M8034"}));
}

TEST(NamedRanges, ACounterOf32BitsIsNoneOf16) {
  const json local = plant("CN200-CN209", {device("press", "mc-1e", kFx3u)});
  expect_may_not(local, allowing(device("new", "mc-1e", kQ), {"CN200"}));
  expect_may(local, allowing(device("new", "mc-1e", kFx3u), {"CN200-CN209"}));
}

/// What only hexadecimal PLCs of the plant can read gives nothing where an octal one is.
TEST(NamedRanges, DigitsOfAnotherBaseMeanNothingToAMachine) {
  const json local = plant("Y0-Y1F", {device("press", "mc-3e", kFx5u), device("saw", "mc-3e", kQ)});
  expect_may_not(local, allowing(device("press", "mc-3e", kQ), {"Y0"}));
  expect_may(local, allowing(device("saw", "mc-3e", kQ), {"Y0-Y1F"}));
}

/// A local model that is still to be asked may have either base.
TEST(NamedRanges, AModelThatIsNotKnownMayBeAny) {
  const json local = plant("Y0-Y17", {device("press", "mc-3e")});
  expect_may(local, allowing(device("press", "mc-3e", kFx5u), {"Y0-Y17"}));
  expect_may_not(local, allowing(device("press", "mc-3e", kQ), {"Y0-Y17"}));
  expect_may(local, allowing(device("press", "mc-3e", kQ), {"Y0-YF"}));
  expect_may(plant("D0-D100", {device("press", "mc-3e")}),
             allowing(device("press", "mc-3e", kQ), {"D0-D100"}));
}

/// What a small PLC lacks cannot be hit there.
TEST(NamedRanges, ASmallPlcOfThePlantDoesNotLimitALargeOne) {
  for (const char* range : {"D200-D399", "Y0-Y17", "M100-M1000"})
    expect_may(plant(range, {device("small", "fx-computer-link", {{"model", "FX1S"}})}),
               allowing(device("large", "fx-computer-link", {{"model", "FX3U"}, {"station", 3}}),
                        {range}));
}

TEST(NamedRanges, DevicesOfOtherKindsDoNotMatter) {
  const json local = plant("W0-W1F", {device("press", "fx-computer-link", kFx3u),
                                      device("meter", "modbus-tcp"), device("saw", "mc-3e", kQ)});
  expect_may(local, allowing(device("new", "mc-3e", kQ), {"W0-W1F"}));
}

/// Where no device of the local file tells, the choice of a model or base still gains nothing.
TEST(NamedRanges, WithoutLocalDevicesAllReadingsMustAgree) {
  const json local = plant("Y0-Y17", {device("meter", "modbus-tcp")});
  expect_may_not(local, allowing(device("new", "mc-3e", kQ), {"Y0-Y17"}));
  expect_may(local, allowing(device("new", "mc-3e", kQ), {"Y0-YF"}));
  expect_may(local, allowing(device("new", "mc-3e", kFx5u), {"Y0-Y17"}));
  expect_may(local, allowing(device("new", "fx-computer-link", kFx3u), {"Y0-Y17"}));
  expect_may_not(local, allowing(device("new", "mc-1e", kQ), {"Y17"}));
  const json hexadecimal = plant("Y0-Y1F", {device("meter", "modbus-tcp")});
  expect_may(hexadecimal, allowing(device("new", "mc-3e", kQ), {"Y0-Y1F"}));
  const json registers = plant("hr:300-hr:309", {device("press", "mc-1e", kFx3u)});
  expect_may(registers, allowing(device("new", "modbus-tcp"), {"hr:300-hr:309"}));
  expect_may_not(registers,
                 allowing(device("new", "modbus-tcp", {{"address_base", 1}}), {"hr:300"}));
}

/// The programming port sends addresses, and beyond the classic map those of an FX2N are others
/// than those of an FX3U.
TEST(NamedRanges, TheProgrammingPortSendsNoAddressOfAnotherMap) {
  const auto by_port = [](const char* model, const char* command_set) {
    return device("press", "fx-programming-port", {{"model", model}, {"command_set", command_set}});
  };
  const json local = plant("M0-M3000", {by_port("FX3U", "auto")});
  expect_may(local, allowing(by_port("FX3U", "auto"), {"M0-M3000"}));
  expect_may(local, allowing(by_port("FX3U", "extended"), {"M0-M3000"}));
  expect_may(local, allowing(by_port("FX2N", "auto"), {"M0-M1535"}));
  expect_may_not(local, allowing(by_port("FX2N", "auto"), {"M1536"}));
  expect_may_not(local, allowing(by_port("FX2N", "extended"), {"M0"}));
  json another = by_port("FX3U", "auto");
  another["name"] = another["link"] = "new";
  expect_may(plant("M0-M3000", {by_port("FX3U", "auto"), device("meter", "modbus-tcp")}),
             allowing(another, {"M0-M3000"}));
  expect_may_not(plant("M0-M3000", {by_port("FX2N", "auto")}), allowing(another, {"M1536"}));
  const json words = plant("D0-D7999", {by_port("FX3U", "auto")});
  expect_may(words, allowing(by_port("FX2N", "extended"), {"D0-D7999"}));
}

TEST(NamedRanges, TheReasonIsSaid) {
  const json local = plant("Y0-Y17", {device("press", "mc-1e", kFx3u)});
  const std::string said = said_of(local, allowing(device("press", "mc-1e", kQ), {"Y0-Y17"}));
  EXPECT_NE(said.find("model, address_base"), std::string::npos) << said;
  const std::string plain = said_of(local, allowing(device("press", "mc-1e", kFx3u), {"Y20"}));
  EXPECT_EQ(plain.find("address_base"), std::string::npos) << plain;
}

}  // namespace
}  // namespace fxagent
