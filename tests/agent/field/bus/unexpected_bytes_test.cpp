#include "agent/field/bus/unexpected_bytes.h"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>

#include "protocol/catalog.h"
#include "protocol/value/bytes.h"
#include "tests/agent/field/field_plant.h"
#include "tests/agent/field/port_frames.h"
#include "tests/support/says.h"

namespace fxagent::test {
namespace {

using Cause = UnexpectedBytes::Cause;

Bytes hex(std::string_view text) { return *from_hex(text); }

/// Converts a frame that a manual prints as text: < STX, > ETX, ! ENQ, . ACK, ? NAK.
Bytes printed(std::string_view text) {
  Bytes bytes;
  for (const char c : text) {
    const auto at = std::string_view("<>!.?").find(c);
    bytes.push_back(at == std::string_view::npos
                        ? static_cast<std::uint8_t>(c)
                        : static_cast<std::uint8_t>("\x02\x03\x05\x06\x15"[at]));
  }
  return bytes;
}

DeviceConfig device_of(std::string_view protocol, Options more = {}) {
  DeviceConfig device = device_on(protocol, codec_of(protocol, more));
  Options options = default_options(*device.protocol);
  for (auto& [key, value] : more) options[key] = value;
  device.options = std::make_shared<const Options>(std::move(options));
  return device;
}

UnexpectedBytes guess(const DeviceConfig& device, const Bytes& received, const Bytes& asked = {}) {
  return looks_like(device, *device.codec, asked, received);
}

// Frames from protocol/README.md, originally from captures and the manuals.
const Bytes kReadD123 = hex("02 30 31 30 46 36 30 34 03 37 34");
const Bytes kD123 = hex("02 33 34 31 32 43 44 41 42 03 44 37");
const Bytes kLinkRead = printed("!05FFBRAX00400547");
const Bytes kLinkData = printed("<05FF01101>E7");
const Bytes kRtuRequest = hex("11 01 00 13 00 13 8E 92");
const Bytes kRtuReply = hex("11 01 03 CD 6B 05 40 12");
const Bytes kAsciiReply = printed(":110103CD6B05AE\r\n");

// ---- a line as received by a UART --------------------------------------------------------------

struct Shape {
  int bits = 7;
  Parity parity = Parity::even;
};

std::vector<bool> on_the_wire(const Bytes& frame, Shape shape) {
  std::vector<bool> line(3, true);
  for (const std::uint8_t byte : frame) {
    line.push_back(false);
    bool sum = shape.parity == Parity::odd;
    for (int i = 0; i < shape.bits; ++i) {
      const bool bit = (byte >> i & 1) != 0;
      line.push_back(bit);
      sum = sum != bit;
    }
    if (shape.parity != Parity::none) line.push_back(sum);
    line.push_back(true);
  }
  line.resize(line.size() + 40, true);
  return line;
}

/// Returns the bytes received by a port of this shape. `bit` is its bit time in bits of the sender.
/// As in the kernel (INPCK), a character with an error arrives as 00 if parity is on.
Bytes received_by(Shape shape, double bit, const std::vector<bool>& line) {
  const auto at = [&line](double time) {
    const auto index = static_cast<std::size_t>(time);
    return index >= line.size() || line[index];
  };
  Bytes received;
  bool before = true;
  for (double now = 0; now < static_cast<double>(line.size()); now += 0.05) {
    const bool level = at(now);
    if (!std::exchange(before, level) || level) continue;
    double sample = now + 1.5 * bit;
    bool sum = shape.parity == Parity::odd;
    std::uint8_t byte = 0;
    for (int i = 0; i < shape.bits; ++i, sample += bit) {
      if (at(sample)) byte = static_cast<std::uint8_t>(byte | 1U << i);
      sum = sum != at(sample);
    }
    bool good = true;
    if (shape.parity != Parity::none) {
      good = at(sample) == sum;
      sample += bit;
    }
    good = good && at(sample);
    received.push_back(!good && shape.parity != Parity::none ? std::uint8_t{0} : byte);
    now = sample;
    before = at(now);
  }
  return received;
}

TEST(UnexpectedBytes, AUartThatIsSetAsTheDeviceHearsItsFrames) {
  EXPECT_EQ(received_by({}, 1, on_the_wire(kD123, {})), kD123);
  EXPECT_EQ(received_by({8, Parity::none}, 1, on_the_wire(kRtuReply, {8, Parity::none})),
            kRtuReply);
}

// ---- the guesses -------------------------------------------------------------------------------

TEST(UnexpectedBytes, TheQuestionItselfIsAnEcho) {
  for (const auto& [protocol, frame] :
       {std::pair{"fx-programming-port", kReadD123}, std::pair{"fx-computer-link", kLinkRead},
        std::pair{"modbus-rtu", kRtuRequest}}) {
    const auto found = guess(device_of(protocol), frame, frame);
    EXPECT_EQ(found.cause, Cause::echo) << protocol << ": " << found.text;
    expect_says(found.text, "set echo");
  }
}

TEST(UnexpectedBytes, AQuestionOfAnotherIsAnotherMaster) {
  const auto found = guess(device_of("fx-computer-link"), kLinkRead, printed("!00FFPC0C5"));
  EXPECT_EQ(found.cause, Cause::another_master);
  expect_says(found.text, "of station 5, \"read X40 × 5\": another master");
}

TEST(UnexpectedBytes, SeveralAnswersOfOneByteAreLateAnswersAndNoWrongSpeed) {
  const auto found = guess(device_of("fx-programming-port"), hex("06 06 06 06"), kReadD123);
  EXPECT_EQ(found.cause, Cause::another_master);
  expect_says(found.text, "late answer (timeout_ms)");
}

TEST(UnexpectedBytes, AnAnswerOfAnotherStationNamesIt) {
  const auto found = guess(device_of("modbus-rtu"), kRtuReply, hex("01 01 00 13 00 13 8D C2"));
  EXPECT_EQ(found.cause, Cause::another_master);
  expect_says(found.text, "of unit 17");
}

struct Foreign {
  std::string_view on;
  Bytes received;
  Cause cause;
  std::string_view says;
};

TEST(UnexpectedBytes, FramesOfOtherProtocolsAreNamed) {
  const Foreign rows[] = {
      {"fx-programming-port", kRtuReply, Cause::other_protocol, "modbus-rtu of unit 17"},
      {"fx-programming-port", kAsciiReply, Cause::other_protocol, "modbus-ascii of unit 17"},
      {"fx-programming-port", kLinkRead, Cause::other_protocol, "fx-computer-link of station 5"},
      {"fx-computer-link", kReadD123, Cause::other_protocol, "fx-programming-port"},
      {"fx-computer-link", hex("15"), Cause::other_protocol, "fx-programming-port"},
      {"fx-computer-link", kRtuRequest, Cause::other_protocol, "modbus-rtu"},
      {"modbus-rtu", kD123, Cause::other_protocol, "fx-programming-port"},
      {"modbus-rtu", kAsciiReply, Cause::other_protocol, "modbus-ascii"},
      {"modbus-rtu", hex("15 01 00 00 00 06 FF 01 03 CD 6B 05"), Cause::other_protocol,
       "modbus-tcp"},
      {"modbus-ascii", kRtuReply, Cause::other_protocol, "modbus-rtu"},
      // Cut short: not a frame, but not noise either.
      {"modbus-rtu", hex("02 33 34 31 32 43 44"), Cause::other_protocol, "fx-programming-port"},
      {"modbus-rtu", printed(":110103CD"), Cause::other_protocol, "modbus-ascii"},
      {"fx-programming-port", printed(":110103CD"), Cause::other_protocol, "modbus-ascii"},
  };
  for (const Foreign& row : rows) {
    const auto found = guess(device_of(row.on), row.received);
    EXPECT_EQ(found.cause, row.cause)
        << row.on << " received " << to_hex(row.received) << found.text;
    expect_says(found.text, row.says);
  }
}

TEST(UnexpectedBytes, AComputerLinkWithOtherSettingsOfD8120IsTold) {
  const auto sums = [](bool on, std::int64_t format) {
    return device_of("fx-computer-link", {{"sum_check", on}, {"format", format}});
  };
  const Bytes without_sum = printed("<05FF01101>");
  Bytes format_4 = kLinkData;
  for (const char c : {'\r', '\n'}) format_4.push_back(static_cast<std::uint8_t>(c));
  expect_says(guess(sums(true, 1), without_sum).text, "set sum_check to false");
  expect_says(guess(sums(false, 1), kLinkData).text, "set sum_check to true");
  expect_says(guess(sums(true, 1), format_4).text, "set format to 4");
  expect_says(guess(sums(true, 4), kLinkData).text, "set format to 1, or format 4 in D8120");
  EXPECT_EQ(guess(sums(true, 1), kLinkData).cause, Cause::another_master)
      << "its settings are right";
}

TEST(UnexpectedBytes, AnMcPortWithOtherSettingsIsToldWhereTheyAre) {
  const auto port = [](std::int64_t format, bool sums = true) {
    return device_of("mc-3c", {{"format", format}, {"sum_check", sums}, {"model", "Q"}});
  };
  const Bytes format_1 = printed("<F90000FF0012340002>BA");
  const Bytes format_2 = printed("<7AF90000FF0012340002>32");
  const Bytes format_3 = printed("<F90000FF00QACK12340002>DA");
  const Bytes format_4 = joined(format_1, hex("0D 0A"));
  const std::pair<std::int64_t, Bytes> received[] = {
      {1, format_1}, {2, format_2}, {3, format_3}, {4, format_4}};
  for (const auto& [theirs, frame] : received) {
    for (const std::int64_t ours : {1, 2, 3, 4}) {
      const auto found = guess(port(ours), frame);
      const std::string wanted = "set format to " + std::to_string(theirs) + ", or format " +
                                 std::to_string(ours) + " in the parameters";
      EXPECT_EQ(found.cause == Cause::other_settings, ours != theirs) << found.text;
      EXPECT_EQ(found.text.find(wanted) != std::string::npos, ours != theirs) << found.text;
      EXPECT_EQ(found.text.find("D8120"), std::string::npos) << found.text;
    }
  }
  const auto with_sum = guess(port(1, false), format_1);
  expect_says(with_sum.text, "or disable the sum check in the parameters");
  expect_says(with_sum.text, "485 Serial Port");
  EXPECT_EQ(with_sum.text.find("D8120"), std::string::npos) << with_sum.text;
}

// PLC answers as in transcripts: 3C and 4C in format 1, 3E in binary code.
const Bytes k3cData = printed("<F90000FF0012340002>BA");
const Bytes k4cData = printed("<F80000FF03FF000012340002>08");
const Bytes k3eData = hex("D0 00 00 FF FF 03 00 06 00 00 00 34 12 02 00");

TEST(UnexpectedBytes, ACutOrSpoiltAnswerOfAnMcPortIsNoFxPlc) {
  for (const auto& [protocol, frame] : {std::pair{"mc-3c", k3cData}, std::pair{"mc-4c", k4cData}}) {
    const DeviceConfig device = device_of(protocol, {{"model", "Q"}});
    const Bytes cut(frame.begin(), frame.end() - 4);
    Bytes spoilt = frame;
    spoilt[12] ^= 0x01;
    for (const Bytes& received : {cut, spoilt}) {
      const auto found = guess(device, received);
      EXPECT_EQ(found.cause, Cause::unknown) << protocol << ": " << found.text;
      EXPECT_EQ(found.text.find("fx-"), std::string::npos) << found.text;
    }
  }
  const auto other = guess(device_of("mc-3c", {{"model", "Q"}}), k4cData);
  expect_says(other.text, "a valid frame of mc-4c");
}

TEST(UnexpectedBytes, StxAndTextMayBeAnyProtocolWhoseFramesBeginSo) {
  const auto found = guess(device_of("modbus-rtu"), printed("<F90000FF0012"));
  EXPECT_EQ(found.cause, Cause::other_protocol) << found.text;
  for (const char* name : {"fx-programming-port", "fx-computer-link", "mc-3c", "mc-4c"})
    expect_says(found.text, name);
}

TEST(UnexpectedBytes, OverEthernetNoBaudRateAndNoParityIsBlamed) {
  for (const char* protocol : {"mc-1e", "mc-3e", "mc-4e", "modbus-tcp"}) {
    const DeviceConfig device = device_of(protocol);
    const Bytes zeros(12, 0);
    const Bytes cut(k3eData.begin(), k3eData.end() - 2);
    const Bytes high = hex("81 82 84 88 90");
    for (const Bytes& received : {zeros, cut, high}) {
      const auto found = guess(device, received);
      EXPECT_EQ(found.cause, Cause::unknown) << protocol << " " << to_hex(received) << found.text;
      for (const char* word : {"baud", "parity", "not text", "fx-"})
        EXPECT_EQ(found.text.find(word), std::string::npos) << protocol << ": " << found.text;
      expect_says(found.text, "protocol");
    }
  }
}

TEST(UnexpectedBytes, FramesOfTextHaveTheirParitySeenOn8BitsToo) {
  for (const auto& [protocol, frame] : {std::pair{"mc-3c", k3cData}, std::pair{"mc-4c", k4cData}}) {
    const Bytes received = received_by({8, Parity::none}, 1, on_the_wire(frame, {7, Parity::even}));
    const auto even = guess(device_of(protocol, {{"model", "Q"}}), received);
    EXPECT_EQ(even.cause, Cause::parity) << even.text;
    expect_says(even.text, "even parity in bit 7");
  }
  // Format 5 is binary, so its bytes may have bit 7 set.
  const auto binary = guess(device_of("mc-4c", {{"model", "Q"}, {"format", std::int64_t{5}}}),
                            hex("8D 81 82 84 A0"));
  EXPECT_EQ(binary.cause, Cause::unknown) << binary.text;
}

TEST(UnexpectedBytes, WrongParityIsSeenInBit7OrAsZeros) {
  for (const std::string_view protocol : {"fx-programming-port", "fx-computer-link"}) {
    const Bytes& frame = protocol == "fx-computer-link" ? kLinkData : kD123;
    const auto found = [&](Shape here, Shape there) {
      return guess(device_of(protocol), received_by(here, 1, on_the_wire(frame, there)));
    };
    // "Opening 8N1 shows 80h-set bytes."
    const auto even = found({8, Parity::none}, {7, Parity::even});
    EXPECT_EQ(even.cause, Cause::parity) << even.text;
    expect_says(even.text, "even parity in bit 7");
    const auto odd = found({8, Parity::none}, {7, Parity::odd});
    expect_says(odd.text, "odd parity in bit 7");
    const auto none = found({7, Parity::even}, {8, Parity::none});
    EXPECT_EQ(none.cause, Cause::parity) << none.text;
    expect_says(none.text, "without parity");
    const auto wrong = found({7, Parity::even}, {7, Parity::odd});
    expect_says(wrong.text, "odd?");
  }
}

TEST(UnexpectedBytes, WrongSpeedIsSeenInTheBits) {
  struct Row {
    std::string_view protocol;
    Bytes frame;
    Shape shape;
    double bit;  ///< bit time of the line, in bits of the device
    std::string_view says;
  };
  const Row rows[] = {
      {"fx-programming-port", kD123, {7, Parity::even}, 0.5, "compare baud"},
      {"fx-programming-port", kD123, {7, Parity::even}, 0.25, "compare baud"},
      {"fx-computer-link", kLinkData, {7, Parity::even}, 1.0 / 12, "compare baud"},
      {"fx-computer-link", kLinkData, {7, Parity::even}, 4, "compare baud"},
      {"fx-programming-port", kD123, {8, Parity::none}, 0.5, "in pairs"},
      {"fx-programming-port", kD123, {8, Parity::none}, 0.25, "in fours"},
      {"fx-programming-port", kD123, {8, Parity::none}, 2, "compare baud"},
      {"modbus-rtu", kRtuReply, {8, Parity::none}, 0.5, "set baud to half"},
      {"modbus-rtu", kRtuReply, {8, Parity::none}, 0.25, "set baud to a quarter"},
      {"modbus-rtu", kRtuReply, {8, Parity::even}, 1.0 / 12, "compare baud"},
  };
  for (const Row& row : rows) {
    const Bytes received = received_by(row.shape, row.bit, on_the_wire(row.frame, row.shape));
    const auto found = guess(device_of(row.protocol), received);
    EXPECT_EQ(found.cause, Cause::speed)
        << row.protocol << " " << row.bit << ": " << to_hex(received) << " " << found.text;
    expect_says(found.text, row.says);
  }
}

TEST(UnexpectedBytes, OfAllElseNothingIsClaimed) {
  for (const Bytes& received : {hex("07"), hex("7F 00"), hex("A5 5A 13"), Bytes{}})
    EXPECT_EQ(guess(device_of("modbus-rtu"), received).cause, Cause::unknown) << to_hex(received);
  // A frame with one bit changed by noise.
  const auto spoilt = guess(device_of("fx-programming-port"),
                            hex("02 33 34 31 32 43 44 41 42 03 44 36"), kReadD123);
  EXPECT_EQ(spoilt.cause, Cause::unknown) << spoilt.text;
}

TEST(UnexpectedBytes, TheFirstSixteenAreShown) {
  EXPECT_EQ(first_bytes(hex("02 33")), "02 33");
  EXPECT_EQ(first_bytes(Bytes(16, 0)), to_hex(Bytes(16, 0)));
  EXPECT_EQ(first_bytes(Bytes(17, 0)), to_hex(Bytes(16, 0)) + " … (17 bytes)");
}

}  // namespace
}  // namespace fxagent::test
