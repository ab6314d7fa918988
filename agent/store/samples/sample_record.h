// Encoding of a sample in memory and on disk until it is sent: a row of CBOR (RFC 8949). Reading it
// needs neither a payload format nor a config. Pure functions, any thread.
//
// One array: ts, seq, boot, meta, span (null: none), flags. For each tag follow its name, kind and
// value, and for a bad tag the reason, since when, and when `value` was read. README.md has the
// bytes. The row has everything that a message contains. So a restart with another config sends
// what the run that read the sample would have sent.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "agent/config/model.h"
#include "agent/handover/telemetry.h"
#include "protocol/value/point.h"
#include "protocol/value/value.h"

namespace fxagent {

/// One tag of a sample, like TagReading, with the name and type that it had when it was read.
struct RecordedReading {
  std::string_view name;
  DataType type = DataType::int16;
  bool scaled = false;            ///< it has a scale or an offset
  std::optional<BadReason> bad;   ///< nullopt: good
  Value value;                    ///< empty if never read
  std::int64_t bad_since_ms = 0;  ///< bad only
  std::int64_t last_ms = 0;       ///< bad only; 0 if never
};

/// A decoded row. The views point into the row.
struct SampleRecord {
  std::int64_t ts_ms = 0;
  std::uint64_t seq = 0;
  std::string_view boot;  ///< boot id of the run that read it
  std::string_view meta;  ///< hash of the device's meta in that run
  std::optional<double> span_ms;
  bool partial = false;
  bool written = false;
  std::vector<RecordedReading> readings;
};

/// Returns the row for a message of `device`.
std::string encode_sample(const Telemetry& message, const DeviceConfig& device,
                          std::string_view boot, std::string_view meta);

/// Reads a row into `record`, reusing its memory. Returns false if the row is damaged; `record` is
/// then unspecified. Accepts any bytes.
bool decode_sample(std::string_view row, SampleRecord& record);

}  // namespace fxagent
