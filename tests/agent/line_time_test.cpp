#include "agent/line_time.h"

#include <gtest/gtest.h>

#include "protocol/catalog.h"
#include "protocol/mc/mc.h"
#include "tests/protocol/gathering_codec.h"

namespace fxagent {
namespace {

using std::chrono::milliseconds;

/// One character per millisecond, so line times count characters.
constexpr milliseconds kCharTime{1};

DeviceConfig device_of(const std::string& protocol) {
  const ProtocolInfo* info = find_protocol(protocol);
  Options options = default_options(*info);
  if (!info->models.empty()) options["model"] = std::string("FX3U");
  DeviceConfig device;
  device.protocol = info;
  device.codec = *info->make(options);
  device.gap = milliseconds(5);
  device.turnaround = milliseconds(30);
  return device;
}

Point point_of(const DeviceConfig& device, const std::string& address) {
  Point point{.address = *device.codec->addresses().parse_address(address, std::nullopt)};
  point.type = default_type(point.address);
  point.order = device.codec->addresses().default_order();
  return point;
}

std::vector<Request> writes_of(const DeviceConfig& device, const std::string& address) {
  const Point point = point_of(device, address);
  return *plan_write(*device.codec, point, Bytes((span_of(point)->bits + 7) / 8));
}

TEST(LineTime, CountsCharactersTurnaroundAndGap) {
  DeviceConfig device = device_of("fx-programming-port");
  const Point d100 = point_of(device, "D100");
  // 11 characters out (STX 0 10C8 02 ETX sum), 8 back (STX 4 digits ETX sum).
  EXPECT_EQ(read_time(*device.codec, device, d100, {}, timing_of(device, kCharTime)),
            milliseconds(11 + 8 + 30 + 5));
  device.enquire = EnquirePolicy::always;
  EXPECT_EQ(read_time(*device.codec, device, d100, {}, timing_of(device, kCharTime)),
            milliseconds(11 + 8 + 30 + 5 + 1 + 1 + 30 + 5));
}

TEST(LineTime, AllowsForAnAnswerWhoseDataAreAllDoubled) {
  const mc::Mc codec({.frame = mc::Frame::c4, .model = mc::Model::fx5u, .format = 5});
  const Request two_words = Read{{id(mc::Space::m), 96, 32}, mc::kWordWay};
  const LineLength length = codec.line_length(two_words);
  EXPECT_EQ(length.more_reply_chars, 4U);
  EXPECT_EQ(exchange_time(codec, two_words, {.char_time = kCharTime}),
            milliseconds(length.request_chars + length.reply_chars + 4));
}

TEST(LineTime, OfAWriteIsThatOfTheCommandAndItsAnswer) {
  const DeviceConfig port = device_of("fx-programming-port");
  // 15 characters out (STX 1 10C8 02 4 digits ETX sum), an ACK back.
  EXPECT_EQ(write_time(*port.codec, writes_of(port, "D100"), timing_of(port, kCharTime)),
            milliseconds(15 + 1 + 30 + 5));
  // Modbus ASCII: ":", "01 06 0064 0001", LRC, CR LF out and the same back.
  const DeviceConfig ascii = device_of("modbus-ascii");
  EXPECT_EQ(write_time(*ascii.codec, writes_of(ascii, "hr:100"), timing_of(ascii, kCharTime)),
            milliseconds(17 + 17 + 30 + 5));
}

TEST(LineTime, OfAWriteCountsTheReadThatMustComeFirst) {
  const ProtocolInfo* info = find_protocol("modbus-ascii");
  Options options = default_options(*info);
  options["allow_read_modify_write"] = true;
  DeviceConfig device = device_of("modbus-ascii");
  device.codec = *info->make(options);
  const Request mask = writes_of(device, "hr:100.3").front();
  const auto by_reading = device.codec->instead_of(mask, 1);  // 01: function 22 is missing
  ASSERT_TRUE(by_reading);
  // One register read (17 characters and 15), then written (17 and 17).
  EXPECT_EQ(write_time(*device.codec, std::span(&*by_reading, 1), timing_of(device, kCharTime)),
            milliseconds(17 + 15 + 30 + 5 + 17 + 17 + 30 + 5));
}

TEST(LineTime, LongestPollIsARead) {
  const DeviceConfig device = device_of("fx-programming-port");
  const LineTiming timing = timing_of(device, kCharTime);
  const Plan word = reads_of(*device.codec, device, point_of(device, "D100"), {});
  const Plan* plans[] = {&word};
  EXPECT_EQ(longest_poll(*device.codec, plans, timing), milliseconds(11 + 8 + 30 + 5));
}

TEST(LineTime, ACommandReadsEachPlaceByItselfWhereAnyWayAllowsIt) {
  // This codec has no batch read for words W.
  auto codec = std::make_shared<test::GatheringCodec>(test::gathering_codec());
  codec->ways[0] = {test::word_way(1, 2, 1)};
  DeviceConfig device = device_of("modbus-ascii");
  device.codec = codec;
  const LineTiming timing = timing_of(device, kCharTime);
  const Plan alone = reads_of(*codec, device, point_of(device, "V100"), {});
  ASSERT_EQ(alone.exchange_count(), 1U);
  EXPECT_TRUE(std::holds_alternative<Read>(alone.request(alone.exchanges[0])));
  const Plan gathered = reads_of(*codec, device, point_of(device, "W100"), {});
  ASSERT_EQ(gathered.exchange_count(), 1U);
  EXPECT_TRUE(std::holds_alternative<Gather>(gathered.request(gathered.exchanges[0])));
  EXPECT_EQ(poll_time(*codec, gathered, timing), milliseconds(14 + 6 + 4 + 30 + 5));
  EXPECT_EQ(read_time(*codec, device, point_of(device, "W100"), {}, timing),
            milliseconds(14 + 6 + 4 + 30 + 5));
}

TEST(LineTime, LongestPollWithoutReadsIsTheQuestionForRunOrWhetherTheDeviceIsThere) {
  // One word, the model in D8001: 11 characters out, 8 back.
  const DeviceConfig port = device_of("fx-programming-port");
  EXPECT_EQ(longest_poll(*port.codec, {}, timing_of(port, kCharTime)),
            milliseconds(11 + 8 + 30 + 5));
  // Modbus has no RUN state: one register, ":", "01 03 0000 0001", LRC, CR LF out and 15 back.
  const DeviceConfig ascii = device_of("modbus-ascii");
  EXPECT_EQ(longest_poll(*ascii.codec, {}, timing_of(ascii, kCharTime)),
            milliseconds(17 + 15 + 30 + 5));
}

TEST(LineTime, DeviceWithTagsOrWithoutAnAnswerIsNotAskedWhetherItIsThere) {
  const DeviceConfig rtu = device_of("modbus-rtu");
  EXPECT_TRUE(background_question(*rtu.codec, /*has_tags=*/false));
  EXPECT_FALSE(background_question(*rtu.codec, /*has_tags=*/true));
  Options options = default_options(*rtu.protocol);
  options["unit"] = std::int64_t{0};
  EXPECT_FALSE(background_question(**rtu.protocol->make(options), /*has_tags=*/false));
  EXPECT_TRUE(background_question(*device_of("fx-computer-link").codec, /*has_tags=*/true));
}

}  // namespace
}  // namespace fxagent
