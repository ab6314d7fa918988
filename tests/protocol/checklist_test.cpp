#include "protocol/checklist.h"

#include <gtest/gtest.h>

#include "protocol/catalog.h"
#include "protocol/fx/computer_link.h"
#include "tests/support/says.h"

namespace fxagent {
namespace {

using test::expect_says;

const LineDefaults kSlow{9600, 7, Parity::even, 1};
const LineDefaults kFast{19200, 8, Parity::odd, 2};

Wiring serial(const LineDefaults& line = kSlow) {
  return {Wiring::Channel::serial, "/dev/ttyUSB0", line, false};
}
Wiring tcp() { return {Wiring::Channel::tcp, "192.0.2.10:5007", {}, false}; }

std::string text_of(std::string_view protocol, Options more, const Wiring& wiring,
                    Answers answers = Answers::none) {
  const ProtocolInfo& info = *find_protocol(protocol);
  Options options = default_options(info);
  for (auto& [key, value] : more) options[key] = value;
  const auto codec = info.make(options);
  EXPECT_TRUE(codec.has_value()) << codec.error().text;
  return checklist(info, options, **codec, wiring, answers);
}

#define EXPECT_OMITS(text, part) EXPECT_EQ((text).find(part), std::string::npos) << (text)

TEST(Checklist, ModbusOnALineNamesUnitLineWiresEchoAndOtherMasters) {
  for (const char* protocol : {"modbus-rtu", "modbus-ascii"}) {
    const std::string text = text_of(protocol, {{"unit", std::int64_t{17}}}, serial(kFast));
    for (const char* part :
         {"no answer on /dev/ttyUSB0. Check: does the device have power", "`unit` (17)",
          "19200 baud 8O2", "A and B", "set `echo`", "`rs485`", "another program, panel or master"})
      expect_says(text, part);
  }
  expect_says(text_of("modbus-rtu", {}, serial()), "RTU, not ASCII");
  expect_says(text_of("modbus-ascii", {}, serial()), "ASCII, not RTU");
}

TEST(Checklist, EchoThatIsSetIsQuestioned) {
  Wiring wiring = serial();
  wiring.echo = true;
  const std::string text = text_of("modbus-rtu", {}, wiring);
  expect_says(text, "as `echo` says");
  EXPECT_OMITS(text, "set `echo`");
}

TEST(Checklist, ComputerLinkNamesStationD8120AndThePowerCycle) {
  const std::string text =
      text_of("fx-computer-link", {{"station", std::int64_t{3}}, {"sum_check", false}}, serial());
  for (const char* part :
       {"D8121 of the PLC `station` (3)", "`format` (1)", "`sum_check` (false)",
        "is D8120 H4086 (9600 baud 7E1, RS-485)", "switched off and on", "A and B"})
    expect_says(text, part);
  EXPECT_OMITS(text_of("fx-computer-link", {}, tcp()), "is D8120 H")
      << "the line behind the serial server is not known";
}

// JY992D69901: bits 0 to 3 are data, parity and stop, 4 to 7 speed, 13 sum check, 14 computer link,
// 15 format 4. The first two values come from working PLCs, see protocol/README.md.
TEST(Checklist, D8120IsThatOfTheManual) {
  const Options format1{{"format", std::int64_t{1}}, {"sum_check", true}};
  const Options format4{{"format", std::int64_t{4}}, {"sum_check", true}};
  const Options no_sum{{"format", std::int64_t{1}}, {"sum_check", false}};
  EXPECT_EQ(fx::d8120(format1, kSlow), 0x6086);
  EXPECT_EQ(fx::d8120(format4, kSlow), 0xE086);
  EXPECT_EQ(fx::d8120(no_sum, kFast), 0x409B);
  EXPECT_EQ(fx::d8120(format1, {300, 8, Parity::none, 1}), 0x6031);
  EXPECT_EQ(fx::d8120(format1, {38400, 7, Parity::even, 1}), 0x60A6);
  EXPECT_EQ(fx::d8120(format1, {57600, 7, Parity::even, 1}), std::nullopt);
}

TEST(Checklist, ProgrammingPortNamesCableAndOtherUsersButNoStation) {
  const std::string text = text_of("fx-programming-port", {}, serial());
  for (const char* part : {"programming cable", "GX Works", "9600 baud 7E1", "fx-computer-link"})
    expect_says(text, part);
  EXPECT_OMITS(text, "A and B");
}

TEST(Checklist, ModbusTcpNamesUnitGatewayAndConnections) {
  const std::string text = text_of("modbus-tcp", {{"unit", std::int64_t{7}}}, tcp());
  for (const char* part : {"no answer on 192.0.2.10:5007", "`unit` (7)", "gateway", "A and B",
                           "connections", "modbus-rtu"})
    expect_says(text, part);
}

TEST(Checklist, McNamesCodeFormatStationAndARouteThatIsSet) {
  expect_says(text_of("mc-3e", {{"code", std::string("ascii")}}, tcp()), "`code` (ascii)");
  EXPECT_OMITS(text_of("mc-3e", {}, tcp()), "`network`");
  expect_says(text_of("mc-3e", {{"network", std::int64_t{2}}}, tcp()), "`network` (2)");
  const std::string text = text_of("mc-4c", {{"station", std::int64_t{4}}}, serial(kFast));
  for (const char* part : {"`station` (4)", "`format` (", "`sum_check` (true)", "19200 baud 8O2",
                           "switched off and on"})
    expect_says(text, part);
}

TEST(Checklist, SerialServerHasTheLine) {
  const std::string text = text_of("modbus-rtu", {}, tcp());
  expect_says(text, "serial server's line");
  expect_says(text, "modbus-tcp");
  EXPECT_OMITS(text, "of this port");
}

TEST(Checklist, OnlyADeviceOfAnotherProtocolIsAskedIfItNeeds3E) {
  for (const std::string_view model : find_protocol("mc-3e")->models) {
    const std::string text = text_of("mc-3e", {{"model", std::string(model)}}, tcp());
    EXPECT_OMITS(text, "mc-3e");
    expect_says(text, "`code` (binary)");
  }
  const std::string text = text_of("mc-3e", {}, tcp());
  EXPECT_OMITS(text, "mc-3e");
  expect_says(text, "is it an FX3 (it needs mc-1e)?");
  for (const char* model : {"auto", "Q", "L"})
    expect_says(text_of("mc-4e", {{"model", std::string(model)}}, tcp()), "(it needs mc-3e)");
}

TEST(Checklist, NeighboursThatAnswerNarrowItDown) {
  const std::string text =
      text_of("modbus-rtu", {{"unit", std::int64_t{5}}}, serial(), Answers::from_others);
  expect_says(text, "other devices on /dev/ttyUSB0 answer");
  expect_says(text, "`unit` (5)");
  EXPECT_OMITS(text, "another program");
}

TEST(Checklist, DeviceThatStoppedHasTheRightUnit) {
  const std::string line = text_of("modbus-rtu", {}, serial(), Answers::until_now);
  expect_says(line, "it has answered before");
  expect_says(line, "cable");
  EXPECT_OMITS(line, "`unit`");
  expect_says(text_of("mc-3e", {}, tcp(), Answers::until_now), "network");
}

TEST(Checklist, DeviceThatStoppedAloneIsNamedWithItsWire) {
  const auto text = [](const Wiring& wiring) {
    return text_of("modbus-rtu", {{"unit", std::int64_t{5}}}, wiring, Answers::others_now);
  };
  expect_says(text(tcp()), "other devices on 192.0.2.10:5007 still answer");
  expect_says(text(tcp()), "is its own wire behind 192.0.2.10:5007 in order");
  expect_says(text(serial()), "`unit` (5) has answered before");
  expect_says(text(serial()), "is its own wire in order");
  expect_says(text_of("mc-3c", {}, serial(), Answers::others_now), "`station` (0)");
  EXPECT_EQ(text_of("mc-3e", {}, tcp(), Answers::others_now).find("the device has answered"), 0U);
}

TEST(Checklist, EveryProtocolHasOneThatFitsALogLine) {
  for (const ProtocolInfo& info : catalog()) {
    EXPECT_FALSE(info.hints.silent.empty()) << info.name;
    std::vector<std::string_view> models(info.models.begin(), info.models.end());
    models.push_back(kAutoModel);
    for (const std::string_view model : models)
      for (const Wiring& wiring : {serial(), tcp()})
        for (const Answers answers : {Answers::none, Answers::from_others, Answers::of_gateway,
                                      Answers::until_now, Answers::others_now}) {
          if (wiring.line && !info.on_serial) continue;
          const std::string text =
              text_of(info.name, {{"model", std::string(model)}}, wiring, answers);
          EXPECT_LE(text.size(), 1000U) << info.name << ": " << text;
          EXPECT_EQ(text.back(), '?') << text;
          EXPECT_EQ(text.find('?'), text.size() - 1) << text;
        }
  }
}

}  // namespace
}  // namespace fxagent
