// Commands on their way to the field, and their results on the way back. Plain data: no wires, no
// JSON, no MQTT.
#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "agent/handover/frame_trace.h"
#include "agent/steady_time.h"
#include "protocol/value/bytes.h"
#include "protocol/value/point.h"
#include "protocol/value/value.h"

namespace fxagent {

enum class Op : std::uint8_t { write, force_on, force_off, read, run, stop };
inline constexpr std::string_view kOpNames = "write, force_on, force_off, read, run, stop";
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
  yielded,
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
  std::string sender;               ///< a page token or a profile, verified; empty: see Command::by
  std::string_view ops = kOpNames;  ///< listed when another op is refused
  /// Called once with the result as JSON. Empty: no caller waits.
  std::function<void(const std::string& result)> reply;
};
/// A command that comes from the page or from a profile instead of the agent's own session.
struct RelayedCommand : MessageProperties {
  std::string device;   ///< its name
  std::string payload;  ///< as on a command topic
};

/// The part that a command and its result share.
struct CommandHead : MessageProperties {
  std::uint32_t device = 0;
  std::uint64_t number = 0;   ///< command number in the audit; 0: none
  std::string id;             ///< empty if no id could be read: null in the result
  bool id_is_number = false;  ///< the id came as a JSON integer; `id` is its decimal text
  bool is_list = false;       ///< the payload had a `targets` list
  bool dry_run = false;
};

struct Command : CommandHead {
  std::optional<Op> op;
  std::string op_text;  ///< as received, for the result
  std::vector<CommandTarget> targets;
  std::optional<std::int64_t> expires_ms;
  std::optional<Value> expect;
  std::optional<bool> verify;
  std::string by;
  std::optional<Refusal> refusal;
  /// Set for the command line's `read`, which may read addresses outside the allow list.
  bool any_address = false;
};
/// Returns who sent the command, as well as it is known; empty: it names nobody.
inline const std::string& sender_of(const Command& command) {
  return command.sender.empty() ? command.by : command.sender;
}

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

/// How a command, or one of its targets, ended.
struct CommandOutcome {
  CommandStatus status = CommandStatus::rejected;
  Reason reason = Reason::none;
  std::string detail;
  PlcAnswer plc = PlcAnswer::none;
  std::optional<Progress> progress;  ///< for partial, and unknown_outcome over several exchanges
};

struct TargetResult : CommandOutcome {
  std::string tag;
  std::string address;
  std::optional<Value> value;  ///< value actually written, or read
  std::optional<Verification> verify;
};

/// `sender` is sender_of() its command.
struct CommandResult : CommandOutcome, CommandHead {
  std::string op;
  bool one_frame = false;  ///< list only: one frame carried all targets
  /// Exactly one unless is_list; may be empty if none could be read.
  std::vector<TargetResult> targets;
  int attempts = 0;  ///< number of times the command was sent

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

  FrameTrace frames;                ///< only for a command that was carried out
  std::weak_ptr<std::string> kept;  ///< its text for a DUPLICATE, without a journal; see IdMemory
};

}  // namespace fxagent
