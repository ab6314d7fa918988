#include "protocol/device_numbers.h"

#include <gtest/gtest.h>

#include <memory>
#include <string>

namespace fxagent {
namespace {

std::shared_ptr<const Codec> codec_of(const ProtocolInfo& protocol, std::string_view model = {},
                                      std::int64_t base = 0) {
  Options options = default_options(protocol);
  if (!model.empty()) options["model"] = std::string(model);
  if (options.contains("address_base")) options["address_base"] = base;
  return *protocol.make(options);
}

/// "Y 0-15 of 1 bits".
std::string read(std::string_view protocol, std::string_view model, std::string_view range,
                 std::int64_t base = 0) {
  const ProtocolInfo& info = *find_protocol(protocol);
  const auto span = codec_of(info, model, base)->addresses().parse_range(range);
  if (!span) return span.error().text;
  const DeviceNumbers numbers = numbers_of(info, *span);
  return std::string(numbers.letters) + " " + std::to_string(numbers.first) + "-" +
         std::to_string(numbers.last) + " of " + std::to_string(numbers.bits) + " bits";
}

TEST(DeviceNumbers, ANameIsTheNumberThatGoesOverTheWire) {
  for (const std::string_view protocol : {"fx-programming-port", "fx-computer-link", "mc-1e"}) {
    EXPECT_EQ(read(protocol, "FX3U", "Y0-Y17"), "Y 0-15 of 1 bits");
    EXPECT_EQ(read(protocol, "FX3U", "M8000-M8010"), "M 8000-8010 of 1 bits");
    EXPECT_EQ(read(protocol, "FX3U", "CN200-CN209"), "CN 200-209 of 32 bits");
    EXPECT_EQ(read(protocol, "FX3U", "D300-D399"), "D 300-399 of 16 bits");
  }
  EXPECT_EQ(read("mc-1e", "Q", "Y0-Y17"), "Y 0-23 of 1 bits");
  EXPECT_EQ(read("mc-1e", "Q", "CN200-CN209"), "CN 200-209 of 16 bits");
  for (const std::string_view protocol : {"mc-3e", "mc-4e", "mc-3c", "mc-4c"}) {
    EXPECT_EQ(read(protocol, "FX5U", "Y0-Y17"), "Y 0-15 of 1 bits");
    EXPECT_EQ(read(protocol, "iQ-R", "Y0-Y17"), "Y 0-23 of 1 bits");
    EXPECT_EQ(read(protocol, "Q", "W10-W1F"), "W 16-31 of 16 bits");
  }
  for (const std::string_view protocol : {"modbus-rtu", "modbus-ascii", "modbus-tcp"}) {
    EXPECT_EQ(read(protocol, "", "hr:300-hr:309"), "hr 300-309 of 16 bits");
    EXPECT_EQ(read(protocol, "", "hr:300-hr:309", 1), "hr 299-308 of 16 bits");
    EXPECT_EQ(read(protocol, "", "co:5"), "co 5-5 of 1 bits");
    EXPECT_EQ(read(protocol, "", "40301-40310", 1), "hr 300-309 of 16 bits");
  }
}

TEST(DeviceNumbers, WhatAModelHasOfTheLetters) {
  const auto lettered = [](std::string_view protocol, std::string_view model,
                           std::string_view letters) {
    const ProtocolInfo& info = *find_protocol(protocol);
    return devices_lettered(info, *codec_of(info, model), letters);
  };
  using Runs = std::vector<DeviceNumbers>;
  const Runs of_m = {{"M", 1, 0, 7679}, {"M", 1, 8000, 8511}};
  EXPECT_EQ(lettered("fx-computer-link", "FX3U", "M"), of_m);
  EXPECT_EQ(lettered("mc-1e", "FX3U", "M"), of_m);
  EXPECT_EQ(lettered("mc-1e", "auto", "M"), of_m);
  EXPECT_EQ(lettered("mc-1e", "Q", "M"), (Runs{{"M", 1, 0, 8191}}));
  EXPECT_EQ(lettered("mc-3e", "FX5U", "Y"), (Runs{{"Y", 1, 0, 1023}}));
  EXPECT_EQ(lettered("fx-programming-port", "FX3U", "W"), Runs{});
  EXPECT_EQ(lettered("modbus-tcp", "", "hr"), (Runs{{"hr", 16, 0, 65535}}));
  EXPECT_EQ(lettered("modbus-tcp", "", "D"), Runs{});
}

/// A protocol that comes anew must be told apart there.
TEST(DeviceNumbers, EveryProtocolOfTheCatalogHasLetters) {
  for (const ProtocolInfo& protocol : catalog()) {
    const auto codec = widest_of(protocol, codec_of(protocol));
    const std::string range = protocol.models.empty() ? "hr:0-hr:9" : "D0-D9";
    const auto span = codec->addresses().parse_range(range);
    ASSERT_TRUE(span) << protocol.name;
    const DeviceNumbers numbers = numbers_of(protocol, *span);
    EXPECT_EQ(numbers.last, 9u) << protocol.name;
    const auto all = devices_lettered(protocol, *codec, numbers.letters);
    ASSERT_FALSE(all.empty()) << protocol.name;
    EXPECT_EQ(all.front().bits, 16u) << protocol.name;
    EXPECT_EQ(all.front().first, 0u) << protocol.name;
  }
}

}  // namespace
}  // namespace fxagent
