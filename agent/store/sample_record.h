// A sample as it is kept in memory and on disk until it is sent: a row of CBOR (RFC 8949) that no
// payload format and no config is needed to read. Pure functions, any thread.
//
// One array: ts, seq, boot, meta, span (null: none), flags, then for each tag its name, its kind
// and its value, and behind a bad one why, since when, and when `value` was read. README.md has the
// bytes. Everything that a message says is in it, so that what a restart with another config sends
// is what the run that read it would have sent.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "agent/config/config.h"
#include "agent/messages.h"
#include "protocol/point.h"

namespace fxagent {

/// One tag of a sample, as TagReading, with what it was called and of what type it was then.
struct RecordedReading {
  std::string_view name;
  DataType type = DataType::int16;
  bool scaled = false;            ///< it has a scale or an offset
  std::optional<BadReason> bad;   ///< nullopt: good
  Value value;                    ///< empty where it was never read
  std::int64_t bad_since_ms = 0;  ///< bad only
  std::int64_t last_ms = 0;       ///< bad only; 0 if never
};

/// What a row says. The views are of the row.
struct SampleRecord {
  std::int64_t ts_ms = 0;
  std::uint64_t seq = 0;
  std::string_view boot;  ///< of the run that read it
  std::string_view meta;  ///< the mark of the device's meta in that run
  std::optional<double> span_ms;
  bool partial = false;
  bool written = false;
  std::vector<RecordedReading> readings;
};

/// The row of a message of `device`.
std::string encode_sample(const Telemetry& message, const DeviceConfig& device,
                          std::string_view boot, std::string_view meta);

/// Reads a row into `record`, whose memory is used again. False: the row is damaged, and what is in
/// `record` says nothing. Takes any bytes.
bool decode_sample(std::string_view row, SampleRecord& record);

}  // namespace fxagent
