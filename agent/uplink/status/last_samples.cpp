#include "agent/uplink/status/last_samples.h"

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <utility>

#include "agent/store/samples/sample_record.h"

namespace fxagent {
namespace {

/// Owned by the values of a group, and by the values that a command's sample made from them.
using Row = std::shared_ptr<const std::string>;

Row row_of(const Telemetry& message, const DeviceConfig& device) {
  std::string row = encode_sample(message, device, {}, {});
  row.shrink_to_fit();
  return std::make_shared<const std::string>(std::move(row));
}

class RecordedValues final : public GroupValues {
 public:
  explicit RecordedValues(Row whole) : whole_(std::move(whole)) {}

  /// Call only before the object is published.
  void put(std::uint32_t tag, Row row) { written_.insert_or_assign(tag, std::move(row)); }

  std::map<std::string, LastValue, std::less<>> by_tag() const override {
    std::map<std::string, LastValue, std::less<>> values;
    SampleRecord record;
    if (whole_) add(*whole_, record, values);
    for (const auto& [tag, row] : written_) add(*row, record, values);
    return values;
  }

 private:
  static void add(const std::string& row, SampleRecord& record,
                  std::map<std::string, LastValue, std::less<>>& values) {
    if (!decode_sample(row, record)) return;  // cannot happen: the row never left memory
    for (RecordedReading& reading : record.readings) {
      LastValue value;
      value.type = reading.type;
      value.scaled = reading.scaled;
      value.value = std::move(reading.value);
      value.bad = reading.bad;
      value.written = record.written;
      if (!reading.bad)
        value.ts_ms = record.ts_ms;
      else if (reading.last_ms != 0)
        value.ts_ms = reading.last_ms;
      value.bad_since_ms = reading.bad ? reading.bad_since_ms : 0;
      values.insert_or_assign(std::string(reading.name), std::move(value));
    }
  }

  Row whole_;  ///< null: none yet
  std::map<std::uint32_t, Row> written_;
};

}  // namespace

void LastSamples::change(const ConfigChange& change) {
  if (groups_.empty()) return;
  for (const std::uint32_t device : change.devices_end) groups_.at(device).clear();
  groups_.resize(config_.devices.size());
  for (const std::uint32_t device : change.devices_begin)
    groups_.at(device).resize(config_.devices[device].groups.size());
}

void LastSamples::add(const Telemetry& message) {
  if (groups_.empty())
    for (const DeviceConfig& each : config_.devices) groups_.emplace_back(each.groups.size());
  const DeviceConfig& device = config_.devices.at(message.device);
  auto& group = groups_.at(message.device).at(message.group);
  if (!message.partial) {
    group = std::make_shared<const RecordedValues>(row_of(message, device));
    return;
  }
  // groups_ contains no other type.
  const auto* const before = static_cast<const RecordedValues*>(group.get());
  auto after = before == nullptr ? std::make_shared<RecordedValues>(nullptr)
                                 : std::make_shared<RecordedValues>(*before);
  for (const TagReading& reading : message.readings) {
    Telemetry one = message;
    one.readings = {reading};
    after->put(reading.tag, row_of(one, device));
  }
  group = std::move(after);
}

}  // namespace fxagent
