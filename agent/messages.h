// Values that pass between the field and the uplink. Plain data: no wires, no JSON, no MQTT. Fields
// named `_ms` hold milliseconds UTC since 1970; durations are std::chrono.
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "agent/duration_histogram.h"
#include "protocol/bytes.h"
#include "protocol/point.h"

namespace fxagent {

class Codec;

using SteadyTime = std::chrono::steady_clock::time_point;

/// Converts a system clock reading to milliseconds UTC since 1970.
inline std::int64_t utc_ms(std::chrono::system_clock::time_point t) {
  return std::chrono::duration_cast<std::chrono::milliseconds>(t.time_since_epoch()).count();
}

// ---- telemetry --------------------------------------------------------------------------------

enum class BadReason : std::uint8_t { timeout, nak, bad_frame, link_down, unsupported, bad_value };
/// Returns the payload's word: "timeout", "nak" …
std::string_view to_string(BadReason reason);

/// Reading of one tag within one message. `value` holds the value just read when the tag is good,
/// or the last good value (if any) when it is bad.
struct TagReading {
  std::uint32_t tag = 0;          ///< index in DeviceConfig::tags
  std::optional<BadReason> bad;   ///< nullopt: good
  Value value;                    ///< empty if the tag was never read
  std::int64_t bad_since_ms = 0;  ///< bad only: when the tag turned bad
  std::int64_t last_ms = 0;       ///< bad only: when `value` was read; 0 if never
};

/// Sample of one group of one device, read in one cycle. A partial sample holds one tag after a
/// write.
struct Telemetry {
  std::uint32_t device = 0;  ///< index in Config::devices
  std::uint32_t group = 0;
  std::uint64_t seq = 0;  ///< per device, assigned when the sample leaves the field
  std::int64_t ts_ms = 0;
  std::optional<double> span_ms;  ///< first to last reply; set if more than one exchange was needed
  bool partial = false;           ///< holds only the tag that a command has just written
  bool written = false;           ///< partial only: the value was written and not read back
  std::vector<TagReading> readings;
};

// ---- device states ----------------------------------------------------------------------------

struct DeviceStatus {
  enum class State : std::uint8_t { offline, degraded, online };
  std::uint32_t device = 0;
  State state = State::offline;
  std::int64_t since_ms = 0;
  std::string reason;       ///< empty: none
  std::string reason_text;  ///< human-readable `reason`: what to check; empty: no text
  std::string model;        ///< empty: unknown
  /// The model in the config if the PLC is a different one; else empty.
  std::string model_configured{};
  std::optional<bool> run;
  /// Codec that interprets the device's addresses: the config's, or the one for the detected model.
  /// Null: unchanged. Both threads read it; neither modifies it.
  std::shared_ptr<const Codec> codec{};
};
std::string_view to_string(DeviceStatus::State state);

// ---- commands ---------------------------------------------------------------------------------

/// Bytes that crossed a wire together.
struct WireFrame {
  enum class Way : std::uint8_t { out, in };
  Way way = Way::out;
  Bytes bytes;
};

/// Frames that a command sent and received, for the audit. Bounded: keeps the beginning of a long
/// exchange and counts the rest.
class FrameTrace final {
 public:
  static constexpr std::size_t kMostFrames = 64;
  static constexpr std::size_t kMostBytes = 4096;

  void add(WireFrame::Way way, ByteView bytes);
  const std::vector<WireFrame>& frames() const { return frames_; }
  std::uint64_t omitted() const { return omitted_; }  ///< frames dropped for lack of room

 private:
  std::vector<WireFrame> frames_;
  std::size_t bytes_ = 0;
  std::uint64_t omitted_ = 0;
};

enum class Op : std::uint8_t { write, force_on, force_off, read, run, stop };
std::string_view to_string(Op op);
std::optional<Op> op_from(std::string_view word);

/// Reason why a command did not simply succeed. The words are those of the contract, section 5.
enum class Reason : std::uint8_t {
  none,
  too_large,
  bad_json,
  missing_id,
  duplicate_id,
  retained,
  unknown_device,
  bad_op,
  unknown_tag,
  bad_address,
  not_writable,
  not_allowed,
  bad_value,
  out_of_range,
  expired,
  queue_full,
  conflict,
  expect_mismatch,
  nak,
  timeout,
  bad_frame,
  link_down,
  device_offline,
  verify_mismatch,
  broadcast,
  shutting_down,
  reloading,
  store_unavailable,
  interrupted,
};
/// Returns the payload's word; empty for none.
std::string_view to_string(Reason reason);

/// Maximum number of targets in one command. A longer list would occupy the bus for minutes.
inline constexpr std::size_t kMostTargets = 64;

/// Fault found by the parser. Admission reports it at its place in the order of checks.
struct Refusal {
  Reason reason = Reason::bad_json;
  std::string detail;
};

struct CommandTarget {
  std::string tag;      ///< empty: by address
  std::string address;  ///< empty: by tag
  std::optional<DataType> type;
  std::optional<Value> value;
  /// Read by address only: number of elements, or of characters of a string. 0 means one.
  std::uint16_t count = 0;
  std::optional<Refusal> fault{};    ///< fault that the parser found in this target
  std::optional<ByteOrder> order{};  ///< command line only: overrides the configured byte order
};

/// Properties that accompany the payload of a message on a command topic.
struct MessageProperties {
  bool retained = false;
  SteadyTime received{};                               ///< when the MQTT library delivered it
  std::int64_t received_ms = 0;                        ///< the same instant, UTC
  std::optional<std::chrono::seconds> message_expiry;  ///< MQTT 5; counts from `received`
  std::string response_topic;                          ///< MQTT 5; empty: none
  Bytes correlation;
};

struct Command : MessageProperties {
  std::uint32_t device = 0;
  std::uint64_t number = 0;   ///< command number in the audit, shared with its result; 0: none
  std::string id;             ///< empty if no id could be read
  bool id_is_number = false;  ///< the id came as a JSON integer; `id` is its decimal text
  std::optional<Op> op;
  std::string op_text;  ///< as received, for the result
  std::vector<CommandTarget> targets;
  bool is_list = false;  ///< the payload had a `targets` list
  std::optional<std::int64_t> expires_ms;
  std::optional<Value> expect;
  std::optional<bool> verify;
  bool dry_run = false;
  std::string by;
  std::optional<Refusal> refusal;
  /// Set for the command line's `read`, which may read addresses outside the allow list.
  bool any_address = false;
};

/// Returns the approximate memory of a command, in bytes.
std::size_t memory_of(const Command& command);

enum class CommandStatus : std::uint8_t {
  succeeded,
  failed,
  partial,
  rejected,
  expired,
  duplicate,
  unknown_outcome
};
inline constexpr std::array<CommandStatus, 7> kCommandStatuses{
    CommandStatus::succeeded,      CommandStatus::failed,  CommandStatus::partial,
    CommandStatus::rejected,       CommandStatus::expired, CommandStatus::duplicate,
    CommandStatus::unknown_outcome};
std::string_view to_string(CommandStatus status);

enum class PlcAnswer : std::uint8_t { none, ack, nak };
/// Returns the payload's word; empty for none.
std::string_view to_string(PlcAnswer answer);

struct Verification {
  /// Value read back, in the command's units; "run" or "stop" for run/stop.
  std::optional<Value> read;
  bool match = false;
};

/// Progress of a command that takes several exchanges: how many of its elements (for a list: its
/// targets) were certainly carried out.
struct Progress {
  std::uint32_t done = 0;
  std::uint32_t of = 0;
  friend bool operator==(const Progress&, const Progress&) = default;
};

struct TargetResult {
  std::string tag;
  std::string address;
  std::optional<Value> value;  ///< value actually written, or read
  CommandStatus status = CommandStatus::rejected;
  Reason reason = Reason::none;
  std::string detail;
  PlcAnswer plc = PlcAnswer::none;
  std::optional<Progress> progress;  ///< for partial, and unknown_outcome over several exchanges
  std::optional<Verification> verify;
};

struct CommandResult {
  std::uint32_t device = 0;
  std::uint64_t number = 0;   ///< command number
  std::string id;             ///< empty: null in the payload
  bool id_is_number = false;  ///< as in the command
  CommandStatus status = CommandStatus::rejected;
  Reason reason = Reason::none;
  std::string detail;
  PlcAnswer plc = PlcAnswer::none;
  std::optional<Progress> progress;  ///< as for a target; for a list it counts targets
  std::string op;
  bool is_list = false;
  bool one_frame = false;  ///< list only: one frame carried all targets
  std::vector<TargetResult>
      targets;  ///< exactly one unless is_list; may be empty if none could be read
  bool dry_run = false;
  int attempts = 0;  ///< number of times the command was sent

  std::int64_t received_ms = 0;
  SteadyTime received{};
  std::chrono::nanoseconds queue{0};
  std::chrono::nanoseconds wire{0};
  /// From arrival to the hand-over to MQTT; nullopt until then.
  std::optional<std::chrono::nanoseconds> total;
  std::optional<std::chrono::nanoseconds> bound;

  /// Result of an earlier run, in its published form (JSON). If set, only device, id, status, plc,
  /// received_ms and the MQTT 5 properties of this struct are valid.
  std::string recorded;

  /// DUPLICATE only: number of the first command, once that command has a result.
  std::optional<std::uint64_t> first_number;
  /// Result of the first command; null if it must be read from the journal.
  std::shared_ptr<const CommandResult> first;

  // The next three are not part of the remembered result.
  std::string response_topic;
  Bytes correlation;
  FrameTrace frames;  ///< only for a command that was carried out
};

/// Returns the approximate memory of a result in bytes, without `first`.
std::size_t memory_of(const CommandResult& result);

// ---- counters -----------------------------------------------------------------------------------

/// Percentiles p50 and p99 of a duration, in ms; 0 if nothing was measured.
struct Percentiles {
  double p50 = 0;
  double p99 = 0;
};

struct LinkHealth {
  bool open = false;  ///< at present
  std::uint64_t exchanges = 0;
  std::uint64_t timeouts = 0;
  std::uint64_t naks = 0;
  std::uint64_t bad_frames = 0;
  std::uint64_t unexpected_bytes = 0;  ///< bytes received when no answer was due
  std::uint64_t doubts = 0;            ///< number of times these bytes made the bus doubted
  bool doubted = false;
  double busy_percent = 0;
  double load_percent = 0;  ///< load of the bus that the poll intervals ask for; may exceed 100
  Percentiles turnaround_ms;
};

struct DeviceHealth {
  std::uint64_t polls = 0;
  std::uint64_t missed = 0;
  Percentiles late_ms;
  std::uint64_t collected = 0;   ///< samples taken, including suppressed ones
  std::uint64_t suppressed = 0;  ///< samples not reported because on_change found no change
};

/// Duration histograms of one link since the start, for metrics.
struct LinkDurations {
  DurationHistogram turnaround;  ///< the devices' own time, for each answered exchange
  DurationHistogram lateness;    ///< delay of the start of each poll cycle
};

/// Counters of the field, sent to the uplink at every health tick.
struct FieldHealth {
  std::vector<LinkHealth> links;         ///< by index in Config::links
  std::vector<DeviceHealth> devices;     ///< by index in Config::devices
  std::vector<LinkDurations> durations;  ///< parallel to `links`; empty: metrics are off
  // Totals of devices that a reload removed; `devices` no longer includes their counts.
  std::uint64_t ended_collected = 0;
  std::uint64_t ended_suppressed = 0;
};

}  // namespace fxagent
