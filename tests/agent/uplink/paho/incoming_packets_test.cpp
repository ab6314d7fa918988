#include "agent/uplink/paho/incoming_packets.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace fxagent {
namespace {

using namespace std::string_literals;

const std::string kConnack5 = "\x20\x03\x00\x00\x00"s;
const std::string kConnack311 = "\x20\x02\x00\x00"s;

/// Encodes a length as in MQTT 5, section 1.5.5.
std::string number(std::size_t value) {
  std::string digits;
  for (; value >= 128; value /= 128) digits += static_cast<char>(value % 128 + 128);
  return digits + static_cast<char>(value);
}

std::string text(const std::string& words) {
  const char length[] = {static_cast<char>(words.size() >> 8),
                         static_cast<char>(words.size() & 0xFF)};
  return std::string(length, 2) + words;
}

std::string packet(int head, const std::string& body) {
  return static_cast<char>(head) + number(body.size()) + body;
}

/// Builds an MQTT 5 message on topic "a".
std::string publish(int qos, const std::string& properties, const std::string& payload) {
  return packet(0x30 | qos << 1, text("a") + (qos == 0 ? "" : "\x00\x01"s) +
                                     number(properties.size()) + properties + payload);
}

std::string user_properties(std::size_t count) {
  std::string all;
  for (std::size_t i = 0; i < count; ++i) all += "\x26\x00\x00\x00\x00"s;
  return all;
}

/// Returns the bytes that Paho sees if they arrive `at_once` at a time; "refused" if it must stop
/// reading. Like Paho, reads head and length byte by byte and then requests all the rest.
std::string seen(IncomingPackets& packets, std::string bytes, std::size_t at_once = 1 << 30) {
  auto* const all = reinterpret_cast<unsigned char*>(bytes.data());
  const auto read = [&](std::size_t at, std::size_t asked) {
    if (asked > packets.most()) return false;
    while (asked > 0) {
      const std::size_t got = std::min(asked, at_once);
      packets.take(all + at, asked, got);
      at += got;
      asked -= got;
    }
    return true;
  };
  for (std::size_t at = 0; at < bytes.size();) {
    read(at++, 1);
    std::size_t size = 0;
    for (unsigned shift = 0;; shift += 7) {
      const unsigned char digit = all[at];
      read(at++, 1);
      size |= static_cast<std::size_t>(digit & 0x7F) << shift;
      if (digit < 0x80) break;
    }
    if (size != 0 && !read(at, size)) return "refused";
    at += size;
  }
  return bytes;
}

std::string after_connack(const std::string& connack, const std::string& bytes,
                          std::size_t at_once = 1 << 30) {
  IncomingPackets packets;
  EXPECT_EQ(seen(packets, connack), connack);
  return seen(packets, bytes, at_once);
}

TEST(IncomingPackets, OrdinaryPacketsPassAsTheyAre) {
  const std::string bytes = packet(0x90, "\x00\x01\x00\x01"s) + packet(0xD0, "") +
                            publish(1, "\x08"s + text("r") + "\x09"s + text("c"), "{}") +
                            publish(0, "", "{}") + packet(0x40, "\x00\x01"s);
  EXPECT_EQ(after_connack(kConnack5, bytes), bytes);
  EXPECT_EQ(after_connack(kConnack5, bytes, 1), bytes);
}

TEST(IncomingPackets, MessageWithQos2IsOneWithQos1) {
  EXPECT_EQ(after_connack(kConnack5, publish(2, "", "{}")), publish(1, "", "{}"));
  const std::string pubrel = packet(0x62, "\x00\x01"s);
  EXPECT_EQ(after_connack(kConnack5, pubrel), pubrel);
}

TEST(IncomingPackets, PropertiesThatAreTooManyBecomePayloadThatIsNoJson) {
  const std::string wanted = "\x02\x00\x00\x00\x3C"s + "\x08" + text("r/t") + "\x09" + text("cor");
  const std::string properties = user_properties(20'000) + wanted + user_properties(20'000);
  ASSERT_GT(properties.size(), kMaxPropertiesIn);
  for (const std::size_t at_once : {std::size_t{1} << 30, std::size_t{1000}}) {
    const std::string before = publish(1, properties, "{}");
    const std::string after = after_connack(kConnack5, before, at_once);
    ASSERT_EQ(after.size(), before.size());
    // Head and length take four bytes, topic three, identifier two.
    const std::size_t begin = 1 + number(before.size()).size() + 3 + 2;
    EXPECT_EQ(after.substr(0, begin), before.substr(0, begin));
    // A length with as many digits as before, and the properties that the agent uses.
    EXPECT_EQ(after.substr(begin, 3), std::string({static_cast<char>(0x80 | wanted.size()),
                                                   static_cast<char>(0x80), '\0'}));
    EXPECT_EQ(after.substr(begin + 3, wanted.size()), wanted);
    EXPECT_EQ(after[begin + 3 + wanted.size()], '\0');
    EXPECT_GT(after.size() - begin - 3 - wanted.size(), 65536U) << "too large for a command";
  }
}

TEST(IncomingPackets, SecondResponseTopicIsNotKept) {
  const std::string first = "\x08" + text("first");
  const std::string after = after_connack(
      kConnack5, publish(0, first + "\x08" + text("second") + user_properties(40'000), ""));
  EXPECT_EQ(after.substr(1 + 3 + 3, 3 + first.size()),
            std::string({static_cast<char>(0x80 | first.size()), '\x80', '\0'}) + first);
}

TEST(IncomingPackets, PropertiesUpToTheLimitStay) {
  // Of 196,608 bytes, 196,600 are 39,320 user properties; \x01 is a property of two bytes.
  const std::string most = user_properties(39'320) + "\x01\x01\x01\x01\x01\x01\x01\x01";
  ASSERT_EQ(most.size(), kMaxPropertiesIn);
  EXPECT_EQ(after_connack(kConnack5, publish(1, most, "{}")), publish(1, most, "{}"));
  EXPECT_NE(after_connack(kConnack5, publish(1, most + "\x01", "{}")),
            publish(1, most + "\x01", "{}"));
}

// Paho would copy everything up to the end before it detects the error.
TEST(IncomingPackets, LengthBehindTheEndOfThePacketIsBoundedToo) {
  const std::string body = text("a") + number(2'000'000) + user_properties(100'000);
  const std::string after = after_connack(kConnack5, packet(0x30, body));
  EXPECT_EQ(after.substr(1 + 3 + 3, 4), "\x80\x80\x00\x00"s);
}

TEST(IncomingPackets, PayloadOfMqtt311IsNotTakenForProperties) {
  const std::string bytes =
      packet(0x32, text("a") + "\x00\x01"s + number(300'000) + user_properties(70'000));
  EXPECT_EQ(after_connack(kConnack311, bytes), bytes);
}

TEST(IncomingPackets, MessageBeforeConnackIsRefused) {
  IncomingPackets packets;
  EXPECT_EQ(seen(packets, publish(1, "", "{}")), "refused");
}

TEST(IncomingPackets, PacketsHaveTheLimitOfTheirKind) {
  const auto fits = [](int head, std::size_t size) {
    return after_connack(kConnack5, packet(head, std::string(size, '\0'))) != "refused";
  };
  EXPECT_TRUE(fits(0x30, kMaxPacketIn));
  EXPECT_FALSE(fits(0x30, kMaxPacketIn + 1));
  for (const int other : {0x20, 0x40, 0x90, 0xB0, 0xE0, 0xF0}) {
    EXPECT_TRUE(fits(other, kMaxPropertiesIn)) << other;
    EXPECT_FALSE(fits(other, kMaxPropertiesIn + 1)) << other;
  }
}

}  // namespace
}  // namespace fxagent
