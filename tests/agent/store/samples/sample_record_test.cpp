#include "agent/store/samples/sample_record.h"

#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <random>

namespace fxagent {
namespace {

using nlohmann::json;

constexpr std::int64_t kNow = 1790000000000;

TagConfig tag(const std::string& name, DataType type, double scale = 1.0) {
  TagConfig made;
  made.name = name;
  made.point.type = type;
  made.point.scale = scale;
  return made;
}

DeviceConfig device() {
  DeviceConfig made;
  made.tags = {tag("temp", DataType::int16, 0.1), tag("level", DataType::float32),
               tag("label", DataType::string), tag("Ofen 3.läuft", DataType::boolean)};
  return made;
}

Telemetry message(std::vector<TagReading> readings) {
  Telemetry made;
  made.seq = 7;
  made.ts_ms = kNow;
  made.readings = std::move(readings);
  return made;
}

TagReading good(std::uint32_t index, Value value) {
  TagReading made;
  made.tag = index;
  made.value = std::move(value);
  return made;
}

TagReading bad(std::uint32_t index, BadReason why, Value last, std::int64_t last_ms) {
  TagReading made = good(index, std::move(last));
  made.bad = why;
  made.bad_since_ms = kNow - 2000;
  made.last_ms = last_ms;
  return made;
}

std::string row_of(const Telemetry& sample) {
  return encode_sample(sample, device(), "9f3c21aa", "a41c");
}

/// Expects the record to equal the sample it was made from.
void expect_same(const Telemetry& sample, const SampleRecord& record) {
  EXPECT_EQ(record.ts_ms, sample.ts_ms);
  EXPECT_EQ(record.seq, sample.seq);
  EXPECT_EQ(record.boot, "9f3c21aa");
  EXPECT_EQ(record.meta, "a41c");
  EXPECT_EQ(record.span_ms, sample.span_ms);
  EXPECT_EQ(record.partial, sample.partial);
  EXPECT_EQ(record.written, sample.written);
  ASSERT_EQ(record.readings.size(), sample.readings.size());
  const DeviceConfig plc = device();
  for (std::size_t i = 0; i < sample.readings.size(); ++i) {
    const TagReading& in = sample.readings[i];
    const RecordedReading& out = record.readings[i];
    EXPECT_EQ(out.name, plc.tags[in.tag].name);
    EXPECT_EQ(out.type, plc.tags[in.tag].point.type);
    EXPECT_EQ(out.scaled, plc.tags[in.tag].point.scaled());
    EXPECT_EQ(out.bad, in.bad);
    EXPECT_EQ(out.value, in.value);
    if (!in.bad) continue;
    EXPECT_EQ(out.bad_since_ms, in.bad_since_ms);
    EXPECT_EQ(out.last_ms, in.last_ms);
  }
}

TEST(SampleRecord, EachFlagIsItsOwn) {
  for (const bool partial : {false, true})
    for (const bool written : {false, true}) {
      Telemetry sample = message({good(0, Value(23.4))});
      sample.partial = partial;
      sample.written = written;
      SampleRecord record;
      ASSERT_TRUE(decode_sample(row_of(sample), record));
      EXPECT_EQ(record.partial, partial);
      EXPECT_EQ(record.written, written);
    }
}

TEST(SampleRecord, IsCborThatAnyReaderTakes) {
  Telemetry sample = message({good(0, Value(23.4)), good(1, Value(static_cast<double>(5.1F))),
                              bad(3, BadReason::link_down, Value(true), kNow - 3000),
                              good(0, Value::array({std::int64_t{-300}, false}))});
  sample.span_ms = 24.5;
  sample.partial = sample.written = true;
  EXPECT_EQ(json::from_cbor(row_of(sample)), json::parse(R"([
    1790000000000, 7, "9f3c21aa", "a41c", 24.5, 3,
    "temp", 17, 23.4,
    "level", 5, 5.099999904632568,
    "Ofen 3.läuft", 32, true, 3, 1789999998000, 1789999997000,
    "temp", 17, [-300, false]])"));
}

TEST(SampleRecord, BytesAreTheShortestOfRfc8949) {
  DeviceConfig plc;
  plc.tags = {tag("a", DataType::uint16)};
  Telemetry sample = message({good(0, Value(std::int64_t{500}))});
  sample.ts_ms = -1;
  sample.seq = 23;
  // 9 items; -1, 23, "b", "m", null, 0; "a", 2, 500 (Appendix A: 19 01f4 has two bytes)
  const std::string wanted("\x89\x20\x17\x61\x62\x61\x6D\xF6\x00\x61\x61\x02\x19\x01\xF4", 15);
  EXPECT_EQ(encode_sample(sample, plc, "b", "m"), wanted);
  for (const std::int64_t number : {24LL, 255LL, 256LL, 65535LL, 65536LL, 4294967295LL,
                                    4294967296LL, -24LL, -25LL, -256LL, -257LL}) {
    sample.readings[0].value = Value(number);
    const std::string row = encode_sample(sample, plc, "b", "m");
    const std::vector<std::uint8_t> shortest = json::to_cbor(json(number));
    EXPECT_EQ(row.substr(12), std::string(shortest.begin(), shortest.end())) << number;
  }
}

TEST(SampleRecord, NumbersOfTypesAndReasonsAreThoseInFiles) {
  // Numbers from agent/store/README.md.
  const std::vector<DataType> types{DataType::boolean, DataType::int16,  DataType::uint16,
                                    DataType::int32,   DataType::uint32, DataType::float32,
                                    DataType::bcd16,   DataType::bcd32,  DataType::string,
                                    DataType::int64,   DataType::uint64, DataType::float64};
  const std::vector<BadReason> reasons{BadReason::timeout,     BadReason::nak,
                                       BadReason::bad_frame,   BadReason::link_down,
                                       BadReason::unsupported, BadReason::bad_value};
  for (std::size_t i = 0; i < types.size(); ++i) EXPECT_EQ(static_cast<std::size_t>(types[i]), i);
  for (std::size_t i = 0; i < reasons.size(); ++i)
    EXPECT_EQ(static_cast<std::size_t>(reasons[i]), i);
}

TEST(SampleRecord, EveryValueComesBackAsItWas) {
  using Limits = std::numeric_limits<std::int64_t>;
  const std::vector<Value> values{Value(),
                                  Value(true),
                                  Value(std::int64_t{0}),
                                  Value(Limits::max()),
                                  Value(Limits::min()),
                                  Value(BigInteger{"18446744073709551615"}),
                                  Value(BigInteger{"-21474836470000000000"}),
                                  Value(-0.5),
                                  Value(0.1 + 0.2),
                                  Value(1e300),
                                  Value(-std::numeric_limits<double>::infinity()),
                                  Value(3.0),  // stays a real number
                                  Value(std::string("\xC3(\xFF\0x", 5)),
                                  Value(std::string()),
                                  Value::array({}),
                                  Value::array({1.5, std::int64_t{1}, true, std::string("x")})};
  SampleRecord record;
  for (const Value& value : values) {
    const Telemetry sample =
        message({good(2, value), bad(1, BadReason::bad_value, value, 0), good(3, Value(false))});
    const std::string row = row_of(sample);
    ASSERT_TRUE(decode_sample(row, record));
    expect_same(sample, record);
  }
  ASSERT_TRUE(decode_sample(row_of(message({good(0, Value(std::nan("")))})), record));
  EXPECT_TRUE(std::isnan(std::get<double>(record.readings.at(0).value.items.at(0))));
  Telemetry empty = message({});
  empty.seq = std::numeric_limits<std::uint64_t>::max();
  const std::string row = row_of(empty);
  ASSERT_TRUE(decode_sample(row, record));
  expect_same(empty, record);
}

TEST(SampleRecord, CutShortOrLongerItIsDamaged) {
  const std::string row = row_of(
      message({good(0, Value(23.4)), good(2, Value(std::string("ab"))),
               bad(1, BadReason::nak, Value(1.5), kNow), good(0, Value::array({1.5, true}))}));
  SampleRecord record;
  ASSERT_TRUE(decode_sample(row, record));
  for (std::size_t size = 0; size < row.size(); ++size)
    EXPECT_FALSE(decode_sample(row.substr(0, size), record)) << size;
  EXPECT_FALSE(decode_sample(row + '\0', record));
  EXPECT_FALSE(decode_sample("{\"ts\":1}", record));
}

TEST(SampleRecord, CountsThatCannotBeAreDamageAndCostNoMemory) {
  SampleRecord record;
  const std::string head("\x01\x07\x61\x62\x61\x6D\xF6\x00", 8);
  const std::string huge("\x9B\x7F\xFF\xFF\xFF\xFF\xFF\xFF\xFF", 9);
  EXPECT_FALSE(decode_sample(huge + head, record));
  EXPECT_FALSE(decode_sample("\x89" + head + "\x61\x61\x02" + huge, record)) << "an array";
  EXPECT_FALSE(decode_sample("\x89" + head + "\x61\x61\x02\x5B" + huge.substr(1), record));
  EXPECT_FALSE(decode_sample("\x87" + head, record)) << "a tag without its kind";
  EXPECT_FALSE(decode_sample("\x85" + head, record)) << "fewer than its head";
  EXPECT_FALSE(decode_sample("\x89" + head + "\x61\x61\x18\x40\x01", record)) << "no such kind";
  EXPECT_FALSE(decode_sample("\x89" + head + "\x61\x61\x0C\x01", record)) << "no such type";
  EXPECT_TRUE(decode_sample("\x89" + head + "\x61\x61\x08\x01", record));
  EXPECT_FALSE(decode_sample("\x89" + head + "\x61\x61\x08\x9C\x01", record)) << "no such length";
  EXPECT_FALSE(decode_sample("\x89" + head + "\x61\x61\x08\x99\x01", record)) << "half a length";
}

TEST(SampleRecord, AnyBytesCanBeRead) {
  std::minstd_rand random(7);
  const std::string row = row_of(message({good(0, Value(23.4)), good(2, Value(std::string("ab"))),
                                          bad(1, BadReason::nak, Value(1.5), kNow)}));
  SampleRecord record;
  std::size_t taken = 0;
  for (int i = 0; i < 20000; ++i) {
    std::string changed = row;
    for (int n = 0; n < 3; ++n) changed[random() % changed.size()] = static_cast<char>(random());
    if (decode_sample(changed, record)) ++taken;
  }
  EXPECT_GT(taken, 0U);
}

}  // namespace
}  // namespace fxagent
