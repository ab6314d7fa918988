#include <gtest/gtest.h>

#include "protocol/fx/programming_port.h"
#include "tests/support/transcripts.h"

namespace fxagent::fx {
namespace {

using test::hex;

/// STX, the payload, ETX and the correct sum.
Bytes frame(std::string_view payload) {
  Bytes bytes;
  bytes.push_back(0x02);
  bytes.insert(bytes.end(), payload.begin(), payload.end());
  bytes.push_back(0x03);
  append_hex(bytes, byte_sum(ByteView(bytes).subspan(1)), 2);
  return bytes;
}

Explanation explained(Model model, ByteView frame, std::optional<Direction> direction) {
  return ProgrammingPort({.model = model}).explain(frame, direction);
}

Explanation explain(std::string_view payload, Model model = Model::unknown_fx,
                    std::optional<Direction> direction = {}) {
  return explained(model, frame(payload), direction);
}

TEST(Explanation, NamesEveryFrameOfTheTranscripts) {
  for (const test::Exchange& e : test::read_frames("fx_programming_port.txt")) {
    const auto out = explained(*model_named(e.model), e.request, Direction::request);
    if (e.operation == "bad_sum") {
      EXPECT_FALSE(out.ok);
      EXPECT_EQ(out.checksum_given, "00");
      EXPECT_EQ(out.checksum_computed, "3C");
      continue;
    }
    ASSERT_TRUE(out.ok) << "line " << e.line << " " << out.error.value_or("");
    std::string operation = e.operation;
    if (operation.starts_with("explained_")) operation.erase(0, 10);
    EXPECT_EQ(out.operation, operation) << "line " << e.line;
    if (e.command_set != "-" && out.command_set) {
      EXPECT_EQ(out.command_set, e.command_set);
    }
    if (operation != "enquire") {
      EXPECT_EQ(out.checksum_given, out.checksum_computed);
    }
    if (e.device == "-") continue;
    // A read of bits begins at the device's byte, so the explanation names the first bit of that
    // byte.
    const auto [letters, number] = [&] {
      const auto digits = e.device.find_first_of("0123456789");
      return std::pair(e.device.substr(0, digits), e.device.substr(digits));
    }();
    ASSERT_TRUE(out.device) << "line " << e.line;
    if (operation == "read" && out.count && *out.count == e.bytes * 8)
      EXPECT_EQ(out.device->substr(0, letters.size()), letters);
    else
      EXPECT_EQ(*out.device, e.device) << "line " << e.line;
    if (!e.reply.empty()) {
      const auto reply = explained(*model_named(e.model), e.reply, Direction::reply);
      EXPECT_TRUE(reply.ok) << "line " << e.line;
      EXPECT_EQ(reply.direction, Direction::reply);
    }
  }
}

TEST(Explanation, TellsARequestFromAnAnswerByItself) {
  for (const test::Exchange& e : test::read_frames("fx_programming_port.txt")) {
    if (e.operation == "bad_sum") continue;
    const auto out = explained(*model_named(e.model), e.request, std::nullopt);
    EXPECT_TRUE(out.ok) << "line " << e.line;
    // A speed command looks like one data byte, which is the likelier meaning.
    const bool speed = e.request.size() == 6;
    EXPECT_EQ(out.direction, speed ? Direction::reply : Direction::request) << "line " << e.line;
    if (speed) {
      EXPECT_TRUE(out.ambiguous);
    }
  }
}

TEST(Explanation, AForceOfY0OnAnFx1nSaysAllOfIt) {
  const auto out = explained(Model::fx1n, hex("02 45 37 30 30 30 43 03 35 32"), std::nullopt);
  EXPECT_TRUE(out.ok);
  EXPECT_EQ(out.direction, Direction::request);
  EXPECT_TRUE(out.ambiguous);  // six hex digits could also be three bytes of data
  EXPECT_EQ(out.operation, "force_on");
  EXPECT_EQ(out.command, "E7");
  EXPECT_EQ(out.command_set, "extended");
  EXPECT_EQ(out.device, "Y0");
  EXPECT_EQ(out.count, 1U);
  EXPECT_EQ(out.checksum_given, "52");
  EXPECT_EQ(out.checksum_computed, "52");
  EXPECT_FALSE(out.error);
}

TEST(Explanation, AWriteShowsItsWordsAsNumbers) {
  const auto out = explain("E10400002AB15", Model::fx1n);
  EXPECT_EQ(out.operation, "write");
  EXPECT_EQ(out.device, "D0");
  EXPECT_EQ(out.count, 1U);
  EXPECT_EQ(out.values, std::vector<std::string>{"15AB"});
  EXPECT_EQ(explain("10C8C0478563412").values, std::vector<std::string>{"12345678"});
  EXPECT_EQ(explain("10C8C0478563412").device, "CN235");
  EXPECT_EQ(explain("10100015A").device, "M0");
  EXPECT_EQ(explain("10100015A").values,
            (std::vector<std::string>{"0", "1", "0", "1", "1", "0", "1", "0"}));
  // Half of a 32-bit counter, and an address without a device.
  EXPECT_EQ(explain("10C00023412").values, std::vector<std::string>{"1234"});
  EXPECT_EQ(explain("1F000023412").values, std::vector<std::string>{"1234"});
}

TEST(Explanation, AnExtendedAddressIsNamedForTheModel) {
  EXPECT_EQ(explain("E00800002").device, "D8000");
  EXPECT_EQ(explain("E00800002", Model::fx2n).device, std::nullopt);
  EXPECT_EQ(explain("E000E0002", Model::fx2n).device, "D8000");
  EXPECT_EQ(explain("E000E0002", Model::fx1s).device, std::nullopt);
  EXPECT_EQ(explain("E72560").device, "M8037");
  EXPECT_EQ(explain("E70528", Model::fx2n).device, "TC5");
  EXPECT_EQ(explain("E70797").device, "CC7");
  EXPECT_EQ(explain("7FFFF").device, std::nullopt);
}

TEST(Explanation, AnAnswerShowsItsWordsOrTheBitsOfItsBytes) {
  const auto words = explain("3412CDAB");
  EXPECT_TRUE(words.ok);
  EXPECT_EQ(words.direction, Direction::reply);
  EXPECT_FALSE(words.ambiguous);
  EXPECT_EQ(words.operation, "data");
  EXPECT_EQ(words.count, 2U);
  EXPECT_EQ(words.values, (std::vector<std::string>{"1234", "ABCD"}));
  EXPECT_FALSE(words.device);
  const auto bits = explain("09");
  EXPECT_EQ(bits.count, 8U);
  EXPECT_EQ(bits.values[0], "1");
  EXPECT_EQ(bits.values[3], "1");
}

TEST(Explanation, SingleCharactersHaveOneDirection) {
  const auto one = [](const char* text, std::optional<Direction> direction = {}) {
    return explained(Model::unknown_fx, hex(text), direction);
  };
  EXPECT_EQ(one("05").operation, "enquire");
  EXPECT_EQ(one("05").direction, Direction::request);
  EXPECT_EQ(one("06").operation, "ack");
  EXPECT_EQ(one("15").operation, "nak");
  EXPECT_EQ(one("15").direction, Direction::reply);
  EXPECT_TRUE(one("06", Direction::reply).ok);
  EXPECT_EQ(one("06", Direction::request).error, "ack is sent by the PLC only");
  EXPECT_EQ(one("05", Direction::reply).error, "enquire is sent by the computer only");
  EXPECT_FALSE(one("07").ok);
}

std::string error(const Explanation& out) {
  EXPECT_FALSE(out.ok);
  return out.error.value_or("");
}

TEST(Explanation, WhatIsNotAFrameSaysWhy) {
  const auto bytes = [](const char* text) {
    return error(explained(Model::unknown_fx, hex(text), std::nullopt));
  };
  EXPECT_EQ(bytes(""), "no bytes");
  EXPECT_EQ(bytes("30 31"), "the frame does not begin with STX (02)");
  EXPECT_EQ(bytes("02 30 31"), "there is no ETX (03)");
  EXPECT_EQ(bytes("02 30 31 03 36"), "two digits of sum follow ETX, not 1 bytes");
  EXPECT_EQ(bytes("02 30 31 03 36 34 30"), "two digits of sum follow ETX, not 3 bytes");
  EXPECT_EQ(bytes("02 30 31 03 36 35"), "sum 65 given, 64 computed");
  EXPECT_EQ(bytes("02 30 31 03 36 47"), "sum 36 47 given, 64 computed");
  EXPECT_EQ(error(explain("")), "the payload is not hex digits");
  EXPECT_EQ(error(explain("01G")), "the payload is not hex digits");
  EXPECT_EQ(error(explain("GG", Model::unknown_fx, Direction::reply)),
            "the payload is not hex digits");
}

TEST(Explanation, ARequestThatContradictsItselfSaysWhere) {
  EXPECT_EQ(error(explain("010F6")), "the address or the byte count is truncated");
  EXPECT_EQ(error(explain("110F60434")), "2 data digits follow, 8 expected");
  EXPECT_EQ(error(explain("010F60400")), "2 data digits follow, 0 expected");
  EXPECT_EQ(error(explain("010F600")), "a byte count of 0");
  const auto request = [](std::string_view payload) {
    return error(explain(payload, Model::unknown_fx, Direction::request));
  };
  EXPECT_EQ(request("7000"), "a force has four digits of address, not 3");
  EXPECT_EQ(request("2"), "'2' is not a request of this protocol");
  EXPECT_EQ(error(explain("012", Model::unknown_fx, Direction::reply)),
            "an odd number of digits (3); data are two for each byte");
}

TEST(Explanation, AddressesThatAreNoDevicesNameTheirArea) {
  const auto area = [](const Explanation& out) {
    EXPECT_TRUE(out.ok);
    EXPECT_FALSE(out.device);
    return out.fields.back().second;
  };
  EXPECT_EQ(area(explain("080002E")), "program memory");
  EXPECT_EQ(area(explain("E00140002")), "monitor list");
  EXPECT_EQ(area(explain("E00179002")), "monitor result");
  EXPECT_EQ(area(explain("E00A00002")), "2");
  EXPECT_EQ(area(explain("010F701")), "second half of D123");
}

}  // namespace
}  // namespace fxagent::fx
