#include "agent/cli/check/check_target.h"
#include "agent/config/loader.h"
#include "agent/uplink/payload/json_payload.h"

#include <gtest/gtest.h>

namespace fxagent {
namespace {

/// A plant with one group of a tag of each type.
Config plant_of_all_types() {
  const auto config = parse_config(R"({
"agent": {"id": "e", "root": "r"}, "mqtt": {"servers": ["mqtt://127.0.0.1"]},
"links": [{"name": "l", "tcp": {"host": "127.0.0.1", "port": 502}}],
"devices": [{"name": "d", "link": "l", "protocol": "modbus-tcp", "unit": 1,
  "groups": [{"name": "g", "interval_ms": 1000}, {"name": "other", "interval_ms": 1000}],
  "tags": [
    {"name": "bit", "address": "co:0", "group": "g"},
    {"name": "int", "address": "hr:0", "group": "g"},
    {"name": "tenths", "address": "hr:1", "group": "g", "scale": 0.1},
    {"name": "counter", "address": "hr:2", "type": "uint32", "group": "g"},
    {"name": "total", "address": "hr:4", "type": "uint64", "group": "g"},
    {"name": "real", "address": "hr:8", "type": "float32", "count": 3, "group": "g"},
    {"name": "long", "address": "hr:14", "type": "float64", "group": "g"},
    {"name": "text", "address": "hr:18", "type": "string", "length": 20, "group": "g"}]}]})");
  EXPECT_TRUE(config.has_value()) << (config ? "" : config.error().front().text);
  return config ? *config : Config{};
}

/// Returns the bytes of a history message with long values of all tags, good ones or the last of
/// bad ones.
std::size_t bytes(JsonPayload& payload, const DeviceConfig& device, bool bad) {
  const double real = std::numeric_limits<float>::lowest();
  const Value values[] = {Value(false),
                          Value(std::int64_t{-32768}),
                          Value(-3276.8),
                          Value(std::int64_t{4294967295}),
                          Value(BigInteger{"18446744073709551615"}),
                          Value::array(Scalars(3, Scalar(real))),
                          Value(-std::numeric_limits<double>::max()),
                          Value(std::string(20, '\x02'))};
  SampleRecord sample;
  sample.ts_ms = 1'790'000'000'000;
  sample.seq = 1'790'000'000'000;
  sample.boot = "9f3c21aa";
  sample.meta = "a41c0f5b7d2e9368";
  sample.span_ms = 149.2;
  for (std::size_t i = 0; i < device.tags.size(); ++i) {
    RecordedReading reading;
    reading.name = device.tags[i].name;
    reading.type = device.tags[i].point.type;
    reading.scaled = device.tags[i].point.scaled();
    reading.value = values[i];
    if (bad) reading.bad = BadReason::link_down;
    reading.bad_since_ms = reading.last_ms = sample.ts_ms;
    sample.readings.push_back(std::move(reading));
  }
  const auto message = payload.begin_history(16384);
  message->add(sample);
  return message->take({device.name, "fast"}).at(0).payload.size();
}

TEST(LargestMessage, NoSampleIsLargerAndOneIsNearlyAsLarge) {
  const Config config = plant_of_all_types();
  JsonPayload payload(config, "9f3c21aa", "0.1.0");
  const DeviceConfig& device = config.devices.at(0);
  const std::size_t largest = largest_history(payload, device, 0);
  EXPECT_LT(bytes(payload, device, /*bad=*/false), largest);
  EXPECT_LE(bytes(payload, device, /*bad=*/true), largest);
  EXPECT_GT(bytes(payload, device, /*bad=*/true), largest * 9 / 10);
  EXPECT_LT(largest_history(payload, device, 1), 300U);  // a group without tags
}

TEST(LargestMessage, HealthGrowsWithLinksAndDevices) {
  Config config = plant_of_all_types();
  const std::size_t one = largest_health(config);
  EXPECT_GT(one, fxagent::json::health({}, config).size());
  LinkConfig link = config.links.at(0);
  link.name = "l2";
  config.links.push_back(std::move(link));
  EXPECT_GT(largest_health(config), one + 200);
}

}  // namespace
}  // namespace fxagent
