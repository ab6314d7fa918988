// What is known at one moment: last values, device states, last commands, and the counters of
// uplink and field. The uplink makes it (uplink/status_source) and publishes it on the status board
// (status_board.h); health reads it, and whatever else is to show the agent's state reads it too.
// Nobody changes one that is published.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "agent/duration_histogram.h"
#include "agent/messages.h"

namespace fxagent {

struct Config;

/// Where every sample is.
struct SampleCounts {
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

/// One tag as the field reported it last: as a subscriber of the broker would know it who missed
/// nothing.
struct LastValue {
  DataType type = DataType::int16;
  bool scaled = false;                ///< it has a scale or an offset
  Value value;                        ///< the last good one; empty where it was never read
  std::optional<std::int64_t> ts_ms;  ///< when `value` was read; nullopt: never
  std::optional<BadReason> bad;       ///< nullopt: good
  std::int64_t bad_since_ms = 0;      ///< bad only
  bool written = false;               ///< a command wrote `value`, and nothing was read back

  /// How long ago `value` was read and reported. With publish: on_change that can be long before
  /// the last poll: a cycle that has nothing new to say is not reported. At `now_ms` before ts_ms
  /// (the clock was set) it is 0. nullopt: never read.
  std::optional<std::chrono::milliseconds> age(std::int64_t now_ms) const {
    if (!ts_ms) return std::nullopt;
    return std::chrono::milliseconds(std::max<std::int64_t>(0, now_ms - *ts_ms));
  }
};

/// The last values of one group of one device, kept small: decoded when they are asked for. Any
/// thread.
class GroupValues {
 public:
  virtual ~GroupValues() = default;
  /// By the tag's name. A tag that is not there was not reported yet.
  virtual std::map<std::string, LastValue, std::less<>> by_tag() const = 0;
};
/// By index in Config::devices, then in DeviceConfig::groups. Null: nothing was reported yet. The
/// uplink, which replaces it by the next, and each status that has it own it.
using LastValues = std::vector<std::vector<std::shared_ptr<const GroupValues>>>;

/// What became of one command.
struct LastCommand {
  std::string device;  ///< its name; it may be in no config any more
  std::string id;      ///< empty: none could be read
  std::string op;      ///< as it came
  CommandStatus status = CommandStatus::rejected;
  Reason reason = Reason::none;
  std::int64_t ts_ms = 0;  ///< when its result was known
};
/// So many of the agent are kept, the newest.
inline constexpr std::size_t kLastCommands = 16;

/// How it stands with the broker.
struct BrokerStatus {
  std::string server{};  ///< that it is connected to, or tries
  bool connected = false;
  bool subscribed = false;      ///< commands are heard
  std::string not_heard_why{};  ///< connected, and commands are not heard; empty: not known yet
  std::int64_t since_ms = 0;    ///< when it was connected or lost; before the first time the start
  std::string why{};            ///< not connected: why; empty: it is being tried
};

/// Which config is in force, and what became of the last reload.
struct ConfigStatus {
  struct Reload {
    std::string state;  ///< "applied", "unchanged" or "rejected"
    std::int64_t ts_ms = 0;
    std::vector<std::string> errors;  ///< rejected: the first of them, as the log has them
    std::size_t errors_in_all = 0;
  };
  /// Where remote config is allowed: what is known of it.
  struct Remote {
    std::string version;    ///< of the one in force; empty: the local file alone
    std::string state;      ///< as {base}/config/reported has it
    bool confirmed = true;  ///< false: it is on trial
  };
  std::string hash;  ///< of its text, as Config has it
  std::int64_t since_ms = 0;
  std::optional<Reload> last_reload;  ///< nullopt: there was none
  std::optional<Remote> remote;       ///< nullopt: none may come
};

/// By index in Config::devices, where a list has no other word: of `config`, which a reload
/// replaces.
struct AgentStatus {
  /// Never null where the uplink has made it. The uplink and each status made under it own it.
  std::shared_ptr<const Config> config;
  ConfigStatus config_status;
  std::int64_t ts_ms = 0;
  SteadyTime made_at{};                   ///< the same moment
  std::optional<SteadyTime> field_heard;  ///< when the field last told `field`
  BrokerStatus broker;
  std::string boot;
  std::string version;
  std::chrono::seconds uptime{0};
  std::string conflict;  ///< boot of another agent with the same id; empty: there is none
  SampleCounts samples;
  /// Never null. The uplink and each status made since the field counted own it.
  std::shared_ptr<const FieldHealth> field = std::make_shared<const FieldHealth>();
  /// Without their codecs. Null: the field has not said yet. The uplink's retained state and each
  /// status made since the device changed own it.
  std::vector<std::shared_ptr<const DeviceStatus>> devices;
  LastValues values;  ///< empty: no reader wants them, or nothing was reported since one does
  std::vector<std::uint64_t> dropped;  ///< samples, by index in Config::devices
  /// By the same index: the MQTT reason code, "0x97", for which the broker does not take the
  /// device's samples now; empty: it takes them.
  std::vector<std::string> refused;
  std::map<CommandStatus, std::uint64_t> commands;
  /// From the arrival of each command that was carried out to the hand-over of its result to MQTT.
  DurationHistogram command_durations;
  std::vector<LastCommand> last_commands;  ///< the newest last, kLastCommands at the most
  /// "disk"; "memory" if there is none, or it refuses; "hangs" if it does not answer.
  std::string store_state;
  std::string store_set_aside;  ///< name of the damaged file of this run; empty: none
  std::uint64_t store_bytes = 0;
  std::uint64_t audit_records = 0;
  std::string audit_head;            ///< hash of the last of them; empty: there is no audit
  std::optional<double> hours_left;  ///< until the store is full at the present rate
  bool clock_synchronised = false;
  std::uint64_t rss_bytes = 0;
};

}  // namespace fxagent
