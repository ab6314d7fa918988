// The values that pass between the field and the uplink. Plain data: no wires, no JSON, no MQTT.
// Times named _ms are milliseconds UTC since 1970; durations are std::chrono.
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

/// Milliseconds UTC of a system clock reading.
inline std::int64_t utc_ms(std::chrono::system_clock::time_point t) {
  return std::chrono::duration_cast<std::chrono::milliseconds>(t.time_since_epoch()).count();
}

// ---- telemetry --------------------------------------------------------------------------------

enum class BadReason : std::uint8_t { timeout, nak, bad_frame, link_down, unsupported, bad_value };
/// The word of the payload: "timeout", "nak" …
std::string_view to_string(BadReason reason);

/// One tag of one message. Good: `value` is what was read. Bad: `value` is the last good one, if
/// any.
struct TagReading {
  std::uint32_t tag = 0;          ///< index in DeviceConfig::tags
  std::optional<BadReason> bad;   ///< nullopt: good
  Value value;                    ///< empty where it was never read
  std::int64_t bad_since_ms = 0;  ///< bad only: when it turned bad
  std::int64_t last_ms = 0;       ///< bad only: when `value` was read; 0 if never
};

/// One group of one device, read in one cycle; or (partial) one tag after a write.
struct Telemetry {
  std::uint32_t device = 0;  ///< index in Config::devices
  std::uint32_t group = 0;
  std::uint64_t seq = 0;  ///< per device, given when the sample leaves the field
  std::int64_t ts_ms = 0;
  std::optional<double> span_ms;  ///< first to last reply, where there was more than one exchange
  bool partial = false;           ///< only the tag that a command has just written
  bool written = false;           ///< partial: the value is the written one, nothing was read back
  std::vector<TagReading> readings;
};

// ---- device states ----------------------------------------------------------------------------

struct DeviceStatus {
  enum class State : std::uint8_t { offline, degraded, online };
  std::uint32_t device = 0;
  State state = State::offline;
  std::int64_t since_ms = 0;
  std::string reason;       ///< empty: none
  std::string reason_text;  ///< `reason` for a person: what to check; empty: nothing
  std::string model;        ///< empty: unknown
  /// The config's model, when the PLC is another one; empty: it is not.
  std::string model_configured{};
  std::optional<bool> run;
  /// What the device's addresses mean now: the config's codec, or that of the model found by
  /// asking. Null: as it was. Read by both threads, changed by none.
  std::shared_ptr<const Codec> codec{};
};
std::string_view to_string(DeviceStatus::State state);

// ---- commands ---------------------------------------------------------------------------------

/// Bytes that went over a wire together.
struct WireFrame {
  enum class Way : std::uint8_t { out, in };
  Way way = Way::out;
  Bytes bytes;
};

/// What a command put on the wire and what came back, for the audit. Bounded: of a long one the
/// beginning is kept.
class FrameTrace final {
 public:
  static constexpr std::size_t kMostFrames = 64;
  static constexpr std::size_t kMostBytes = 4096;

  void add(WireFrame::Way way, ByteView bytes);
  const std::vector<WireFrame>& frames() const { return frames_; }
  std::uint64_t omitted() const { return omitted_; }  ///< frames that found no room

 private:
  std::vector<WireFrame> frames_;
  std::size_t bytes_ = 0;
  std::uint64_t omitted_ = 0;
};

enum class Op : std::uint8_t { write, force_on, force_off, read, run, stop };
std::string_view to_string(Op op);
std::optional<Op> op_from(std::string_view word);

/// Why a command did not simply succeed: the words of the contract, section 5.
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
  store_unavailable,
  interrupted,
};
/// The word of the payload; empty for none.
std::string_view to_string(Reason reason);

/// So many targets a command may have: a longer list would hold its line for minutes.
inline constexpr std::size_t kMostTargets = 64;

/// A fault that the parser found. Admission answers with it in its place in the order of checks.
struct Refusal {
  Reason reason = Reason::bad_json;
  std::string detail;
};

struct CommandTarget {
  std::string tag;      ///< empty: by address
  std::string address;  ///< empty: by tag
  std::optional<DataType> type;
  std::optional<Value> value;
  /// Of a read by address: elements, or characters of a string; 0: one.
  std::uint16_t count = 0;
  std::optional<Refusal> fault{};    ///< what the parser found wrong with this target
  std::optional<ByteOrder> order{};  ///< of the command line: in place of that of tag or device
};

/// What comes with the payload of a message on a command topic.
struct MessageProperties {
  bool retained = false;
  SteadyTime received{};                               ///< when the library handed it over
  std::int64_t received_ms = 0;                        ///< the same moment, UTC
  std::optional<std::chrono::seconds> message_expiry;  ///< MQTT 5; counts from `received`
  std::string response_topic;                          ///< MQTT 5; empty: none
  Bytes correlation;
};

struct Command : MessageProperties {
  std::uint32_t device = 0;
  std::uint64_t number = 0;   ///< its number in the audit; 0: none. Its result bears it too
  std::string id;             ///< empty: none could be read
  bool id_is_number = false;  ///< it came as a JSON integer, and `id` is its decimal text
  std::optional<Op> op;
  std::string op_text;  ///< as it came, for the result
  std::vector<CommandTarget> targets;
  bool is_list = false;  ///< it came as `targets`
  std::optional<std::int64_t> expires_ms;
  std::optional<Value> expect;
  std::optional<bool> verify;
  bool dry_run = false;
  std::string by;
  std::optional<Refusal> refusal;
  /// The command line's `read` may read what the allow list does not name.
  bool any_address = false;
};

/// What it takes in memory, roughly.
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
/// The word of the payload; empty for none.
std::string_view to_string(PlcAnswer answer);

struct Verification {
  /// What was read back, in the command's units; for run/stop "run" or "stop".
  std::optional<Value> read;
  bool match = false;
};

/// How far a command came that takes several exchanges: so many of its elements (of a list: its
/// targets) were surely carried out.
struct Progress {
  std::uint32_t done = 0;
  std::uint32_t of = 0;
  friend bool operator==(const Progress&, const Progress&) = default;
};

struct TargetResult {
  std::string tag;
  std::string address;
  std::optional<Value> value;  ///< what was really written, or read
  CommandStatus status = CommandStatus::rejected;
  Reason reason = Reason::none;
  std::string detail;
  PlcAnswer plc = PlcAnswer::none;
  std::optional<Progress> progress;  ///< partial; unknown_outcome where it takes several exchanges
  std::optional<Verification> verify;
};

struct CommandResult {
  std::uint32_t device = 0;
  std::uint64_t number = 0;   ///< of its command
  std::string id;             ///< empty: null
  bool id_is_number = false;  ///< as in the command
  CommandStatus status = CommandStatus::rejected;
  Reason reason = Reason::none;
  std::string detail;
  PlcAnswer plc = PlcAnswer::none;
  std::optional<Progress> progress;  ///< as a target's; of a list it counts targets
  std::string op;
  bool is_list = false;
  bool one_frame = false;  ///< list: one frame carried them all
  std::vector<TargetResult>
      targets;  ///< one, unless is_list; may be empty where none could be read
  bool dry_run = false;
  int attempts = 0;  ///< how often the command was sent

  std::int64_t received_ms = 0;
  SteadyTime received{};
  std::chrono::nanoseconds queue{0};
  std::chrono::nanoseconds wire{0};
  /// From its arrival to the hand-over to MQTT; nullopt: that is still to come.
  std::optional<std::chrono::nanoseconds> total;
  std::optional<std::chrono::nanoseconds> bound;

  /// A result that an earlier run has given, as it was published (JSON). Of the other fields only
  /// device, id, status, plc, received_ms and the MQTT 5 properties say something then.
  std::string recorded;

  /// DUPLICATE only: the number of the first command, once it has its result.
  std::optional<std::uint64_t> first_number;
  /// That result; null where it is the journal's to tell.
  std::shared_ptr<const CommandResult> first;

  // These three are not in what is remembered.
  std::string response_topic;
  Bytes correlation;
  FrameTrace frames;  ///< of a command that was carried out
};

/// What it takes in memory, roughly, `first` not counted.
std::size_t memory_of(const CommandResult& result);

// ---- counters -----------------------------------------------------------------------------------

/// p50 and p99 of a duration in ms; 0 where nothing was measured.
struct Percentiles {
  double p50 = 0;
  double p99 = 0;
};

struct LinkHealth {
  bool open = false;  ///< at this moment
  std::uint64_t exchanges = 0;
  std::uint64_t timeouts = 0;
  std::uint64_t naks = 0;
  std::uint64_t bad_frames = 0;
  std::uint64_t unexpected_bytes = 0;  ///< that came when no answer was due
  std::uint64_t doubts = 0;            ///< how often the bus came to be doubted for them
  bool doubted = false;
  double busy_percent = 0;
  double load_percent = 0;  ///< of the line, that the groups' intervals ask for; may be above 100
  Percentiles turnaround_ms;
};

struct DeviceHealth {
  std::uint64_t polls = 0;
  std::uint64_t missed = 0;
  Percentiles late_ms;
  std::uint64_t collected = 0;   ///< samples made, suppressed ones included
  std::uint64_t suppressed = 0;  ///< on_change found nothing to say
};

/// Of one link since the start, for metrics.
struct LinkDurations {
  DurationHistogram turnaround;  ///< the devices' own time, of each exchange that was answered
  DurationHistogram lateness;    ///< how late each poll cycle began
};

/// What the field counted, sent to the uplink at every health tick.
struct FieldHealth {
  std::vector<LinkHealth> links;         ///< by index in Config::links
  std::vector<DeviceHealth> devices;     ///< by index in Config::devices
  std::vector<LinkDurations> durations;  ///< as links; empty: the config asks for no metrics
  // Of devices that a reload has ended, in sum: what they counted is no part of `devices` any more.
  std::uint64_t ended_collected = 0;
  std::uint64_t ended_suppressed = 0;
};

}  // namespace fxagent
