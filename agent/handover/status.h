// Snapshot of the agent: last values, device states, last commands, and the counters of uplink and
// field. The uplink builds it (uplink/status/status_source) and publishes it on the status board
// (status_board.h). Health and every other view of the agent's state read it. A published snapshot
// never changes.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "agent/handover/command_message.h"
#include "agent/handover/field_health.h"
#include "agent/handover/telemetry.h"

namespace fxagent {

struct Config;

/// Location of every sample.
struct SampleCounts {
  std::uint64_t collected = 0;
  std::uint64_t recovered = 0;
  std::uint64_t suppressed = 0;
  std::uint64_t queued = 0;
  std::uint64_t in_flight = 0;
  std::uint64_t stored = 0;
  std::uint64_t acknowledged = 0;
  std::uint64_t dropped = 0;
  std::uint64_t published = 0;  ///< number of sends, including repeats; not part of the balance
  bool miscounted = false;      ///< the field's own count differs from what arrived

  /// Samples that the broker has not acknowledged yet.
  std::uint64_t waiting() const { return queued + in_flight + stored; }
  /// True if each sample is in exactly one place.
  bool balanced() const {
    return !miscounted && collected + recovered == suppressed + waiting() + acknowledged + dropped;
  }
};

/// Last reported state of one tag, as seen by an MQTT subscriber that missed no message.
struct LastValue {
  DataType type = DataType::int16;
  bool scaled = false;                ///< the tag has a scale or an offset
  Value value;                        ///< the last good value; empty if the tag was never read
  std::optional<std::int64_t> ts_ms;  ///< when `value` was read; nullopt: never
  std::optional<BadReason> bad;       ///< nullopt: good
  std::int64_t bad_since_ms = 0;      ///< bad only
};

/// Last values of one group of one device, stored compactly and decoded on request. Any thread.
class GroupValues {
 public:
  virtual ~GroupValues() = default;
  /// Returns the values by tag name. A tag not yet reported is absent.
  virtual std::map<std::string, LastValue, std::less<>> by_tag() const = 0;
};
/// Indexed as Config::devices, then as DeviceConfig::groups. Null: nothing reported yet. Shared by
/// the uplink, which replaces an entry with the next one, and each status that contains it.
using LastValues = std::vector<std::vector<std::shared_ptr<const GroupValues>>>;

/// Outcome of one command.
struct LastCommand {
  std::uint64_t number = 0;  ///< number of the result in this run, from 1
  std::string device;        ///< device name; the config may no longer contain it
  std::string id;            ///< empty if no id could be read
  std::string op;            ///< as received
  std::string by;            ///< first 64 bytes of the sender; empty: the command names none
  std::string target;        ///< tag or address of the first target
  Value value{};             ///< of the first target: 16 elements, 64 bytes of a text
  std::size_t targets = 0;
  CommandStatus status = CommandStatus::rejected;
  Reason reason = Reason::none;
  std::string detail{};
  std::int64_t ts_ms = 0;            ///< when the result was known
  std::chrono::nanoseconds took{0};  ///< in the queue and on the wire
  std::optional<std::chrono::nanoseconds> bound{};
  FrameTrace frames{};
};
/// Number of last commands kept for the whole agent.
inline constexpr std::size_t kLastCommands = 200;

/// State of a profile with a session of its own.
struct ProfileStatus {
  std::string name;  ///< "plain", or "plain@cloud"
  std::string server;
  bool connected = false;
  bool ready = false;    ///< samples are sent; false: not connected, or the host is offline
  std::string why;       ///< why it is not connected; empty: no reason known
  SampleCounts samples;  ///< `suppressed` is 0: the field passes those to no profile
};

/// State of the connection to the broker.
struct BrokerStatus {
  std::string server{};  ///< the broker that the agent is connected to or is trying
  bool connected = false;
  bool subscribed = false;      ///< commands are received
  std::string not_heard_why{};  ///< connected without commands: why; empty: not known yet
  std::int64_t since_ms = 0;    ///< last connect or disconnect; before the first: the start
  std::string why{};            ///< why it is not connected; empty: an attempt is in progress
  /// Kinds of messages that the broker refuses now and the agent repeats: "states", "results". For
  /// samples see AgentStatus::refused.
  std::vector<std::string> refused{};
};

/// The config in force and the outcome of the last reload.
struct ConfigStatus {
  struct Reload {
    std::string state;  ///< "applied", "unchanged" or "rejected"
    std::int64_t ts_ms = 0;
    std::vector<std::string> errors;  ///< rejected only: the first errors, as logged
    std::size_t errors_in_all = 0;
  };
  /// State of remote config, if the agent allows it.
  struct Remote {
    std::string version;    ///< version of the remote config in force; empty: local file only
    std::string state;      ///< as published on {base}/config/reported
    bool confirmed = true;  ///< false: it is on trial
  };
  std::string hash;  ///< of the config text, as in Config
  std::int64_t since_ms = 0;
  std::string change;                 ///< what was different when it came; empty: it is the first
  std::optional<Reload> last_reload;  ///< nullopt: no reload yet
  std::optional<Remote> remote;       ///< nullopt: remote config is not allowed
};

/// Lists are indexed as Config::devices unless they say otherwise. A reload replaces `config`.
struct AgentStatus {
  /// Never null if made by the uplink. Shared by the uplink and each status made with it.
  std::shared_ptr<const Config> config;
  ConfigStatus config_status;
  std::int64_t ts_ms = 0;
  SteadyTime made_at{};                   ///< the same instant as ts_ms
  std::optional<SteadyTime> field_heard;  ///< when the field last sent `field`
  BrokerStatus broker;
  std::vector<ProfileStatus> profiles;  ///< beside the agent's own
  std::string boot;
  std::string version;
  std::chrono::seconds uptime{0};
  std::string conflict;  ///< boot id of another agent with the same id; empty: none
  SampleCounts samples;
  /// Never null. Shared by the uplink and each status made since the field last counted.
  std::shared_ptr<const FieldHealth> field = std::make_shared<const FieldHealth>();
  /// Without their codecs. Null: no report from the field yet. Shared by the uplink's retained
  /// state and each status made since the device changed.
  std::vector<std::shared_ptr<const DeviceStatus>> devices;
  LastValues values;  ///< empty: no reader wants values, or none were reported since one did
  std::vector<std::uint64_t> dropped;  ///< samples, by index in Config::devices
  /// MQTT reason code, such as "0x97", with which the broker currently refuses the device's
  /// samples; empty: it accepts them. Indexed as `dropped`.
  std::vector<std::string> refused;
  std::map<CommandStatus, std::uint64_t> commands;
  /// Time from the arrival of each executed command to the hand-over of its result to MQTT.
  DurationHistogram command_durations;
  /// The newest last; at most kLastCommands.
  std::vector<std::shared_ptr<const LastCommand>> last_commands;
  /// "disk"; "memory" if there is no disk store or it rejects writes; "hangs" if it does not
  /// respond.
  std::string store_state;
  std::int64_t store_since_ms = 0;  ///< ms UTC, when store_state last changed
  std::string store_set_aside;      ///< damaged store file set aside in this run; empty: none
  std::uint64_t store_bytes = 0;
  std::uint64_t audit_records = 0;
  std::string audit_head;            ///< hash of the last audit record; empty: no audit
  std::optional<double> hours_left;  ///< until the store is full at the current rate
  bool clock_synchronised = false;
  std::uint64_t rss_bytes = 0;
};

}  // namespace fxagent
