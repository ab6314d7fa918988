// Messages ↔ JSON. The only place that knows the shape of a payload. Pure functions, any thread.
//
// Whatever comes in, what goes out is valid JSON: no NaN, no Inf, text that is not UTF-8 gets
// U+FFFD. Integers beyond ±2^53 are strings, since a reader's double would change them.
#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "agent/config.h"
#include "agent/messages.h"

namespace fxagent::json {

/// Up to here, and down to its negative, a double holds every integer.
inline constexpr std::int64_t kMaxExactInteger = std::int64_t{1} << 53;

/// One message of one group: the payload of …/data/{group}, and a row of its history.
std::string telemetry(const Telemetry& message, const DeviceConfig& device, std::string_view boot,
                      std::string_view meta_hash);

/// Whether a row is JSON still: what a worn-out disk gives back may not be.
bool is_intact(std::string_view row);
/// {"history":true,"rows":[…]} of rows that telemetry() made.
std::string history(std::span<const std::string_view> rows);
/// What history() adds to its rows and the commas between them.
inline constexpr std::size_t kHistoryFrameBytes = 26;

/// `deaf`: why no command is heard, where that is so.
std::string agent_online(std::int64_t since_ms, std::string_view boot, std::string_view version,
                         const std::optional<std::string>& deaf = std::nullopt);
/// Without `since_ms` (the last will, written before it is known) "since" is null.
std::string agent_offline(std::optional<std::int64_t> since_ms, std::string_view reason,
                          std::string_view boot);
std::string device_state(const DeviceStatus& status);

struct Meta {
  std::string hash;  ///< 16 hex digits over the tags' text: equal tags, equal hash
  std::string text;
};
Meta device_meta(const DeviceConfig& device);

struct Samples {
  std::uint64_t collected = 0;
  std::uint64_t recovered = 0;
  std::uint64_t suppressed = 0;
  std::uint64_t queued = 0;
  std::uint64_t in_flight = 0;
  std::uint64_t stored = 0;
  std::uint64_t acknowledged = 0;
  std::uint64_t dropped = 0;
  std::uint64_t published = 0;  ///< sends, repeats included; no part of the balance
  bool miscounted = false;      ///< the field says that it made other than arrived

  /// Each sample is in exactly one place.
  bool balanced() const {
    return !miscounted && collected + recovered ==
                              suppressed + queued + in_flight + stored + acknowledged + dropped;
  }
};

struct Health {
  std::int64_t ts_ms = 0;
  std::string boot;
  std::string version;
  std::chrono::seconds uptime{0};
  Samples samples;
  FieldHealth field;
  std::vector<std::uint64_t> dropped;  ///< samples, by index in Config::devices
  /// By the same index: the MQTT reason code, "0x97", for which the broker does not take the
  /// device's samples now; empty: it takes them.
  std::vector<std::string> refused;
  std::map<CommandStatus, std::uint64_t> commands;
  std::string store_state;      ///< "disk"; "memory" where there is none, or it cannot be written
  std::string store_set_aside;  ///< name of the damaged file of this run; empty: none
  std::uint64_t store_bytes = 0;
  std::uint64_t audit_records = 0;
  std::string audit_head;            ///< hash of the last of them; empty: there is no audit
  std::optional<double> hours_left;  ///< until the store is full at the present rate
  bool clock_synchronised = false;
  std::uint64_t rss_bytes = 0;
};
std::string health(const Health& health, const Config& config);

/// No result is larger: the details of its targets are left out first, then the values.
inline constexpr std::size_t kMaxResultBytes = 65536;
/// The result of a command, contract section 5. `total` is receipt until now; null where it is not
/// known any more (the first result inside a DUPLICATE).
std::string result(const CommandResult& result, std::optional<std::chrono::nanoseconds> total);

/// What result() made in an earlier run: `recorded` is the text, status and plc are read from it.
/// Where the text is no JSON object any more, the outcome is unknown and `recorded` empty.
CommandResult recorded_result(std::string text);

/// Reads a command; never throws. Whatever is wrong with its form stands in `refusal`: the first
/// fault in the contract's order of checks. What could be read in spite of it is filled in, the id
/// above all. device, retained, times and MQTT 5 properties are the caller's to set.
Command command(std::string_view payload);

/// Text from outside for a terminal, which it must not steer: as it stands in a JSON string of
/// ASCII, without the quotes.
std::string escaped(const std::string& text);

}  // namespace fxagent::json
