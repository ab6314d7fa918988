// Births and deaths of an edge node and its devices: which are due, in the order in which a host
// needs them, and whether the primary host is there to see them. The same for both payloads of
// Sparkplug. Uplink thread. Time is an argument.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "agent/config/config_difference.h"
#include "agent/config/model.h"
#include "agent/handover/telemetry.h"
#include "agent/steady_time.h"
#include "agent/uplink/broker.h"

namespace fxagent::sparkplug {

/// Whether the primary host application is online, by its STATE messages (Sparkplug 3.0, section
/// 5.4). Pure, except for the log. Uplink thread.
class PrimaryHost final {
 public:
  /// `topic` is that of its state; empty: no host is waited for. `old_state`: the state is ONLINE
  /// or OFFLINE, as before Sparkplug 3.0.
  PrimaryHost(std::string topic, bool old_state);

  const std::string& topic() const { return topic_; }
  /// Nothing is known of it in a new session.
  void connection_began() {
    state_ = State::unknown;
    last_ = last_online_ = 0;
  }
  /// Processes a text on topic().
  void hear(std::string_view payload);

  /// True if births and data may be published.
  bool is_online() const { return topic_.empty() || state_ == State::online; }
  /// True if it has said so in this session.
  bool is_offline() const { return state_ == State::offline; }

 private:
  enum class State : std::uint8_t { unknown, online, offline };
  void set(State state, std::int64_t timestamp);

  std::string topic_;
  bool old_state_;
  State state_ = State::unknown;
  // Timestamps in this session, in the host's unit.
  std::int64_t last_ = 0;         ///< of the last state
  std::int64_t last_online_ = 0;  ///< of the last one with which it was online
};

class BirthSchedule final {
 public:
  struct Step {
    enum class Kind : std::uint8_t { node_birth, device_birth, device_death };
    Kind kind = Kind::node_birth;
    std::uint32_t index = 0;  ///< device_birth only: of the device
    std::string device{};     ///< name; empty for node_birth
  };

  /// `config` outlives it. `broker` is the name of the profile's broker.
  BirthSchedule(const Config& config, std::string broker, PrimaryHost host);

  /// Shortest time between two rebirths.
  static constexpr std::chrono::seconds kRebirthEvery{1};

  /// Begins a session. Call before each attempt to connect: the number rises only if a connection
  /// came about since the last call.
  void begin_session();
  /// Number of the session, from 0.
  std::uint64_t session() const { return session_; }

  void connection_began(const Connected& connected);
  void connection_ended();
  /// Topic of the primary host's state; empty: no host is waited for.
  const std::string& host_topic() const { return host_.topic(); }
  /// Processes a message if it is on host_topic(). Returns false if it is not.
  bool hear(const Message& message);
  /// True, once, if the session must leave this server because the host is offline.
  bool take_leave();

  void device_state(const DeviceStatus& status);
  /// Adapts to a config change, which the config already contains.
  void change(const ConfigChange& change);
  /// Makes due() repeat all births, at most once a second.
  void request_rebirth() { rebirth_ = true; }

  /// Returns what is due, once: while the host is offline nothing is.
  std::vector<Step> due(SteadyTime now);
  /// Returns the time by which due() has something without another call.
  SteadyTime next_wake() const;

  /// True if the node is born in this session.
  bool is_born() const { return is_born_; }
  /// Returns the devices that are born in this session.
  std::vector<std::uint32_t> born() const;
  bool is_rebirth_due() const { return rebirth_; }
  bool is_host_online() const { return host_.is_online(); }
  /// True if the device answers and its birth is not too large.
  bool may_send(std::uint32_t device) const;
  std::optional<std::uint32_t> index_of(std::string_view device) const;

  /// Returns the longest payload that the broker accepts, in bytes.
  std::size_t most_bytes() const;
  /// Returns false, reports that once a session and leaves the device unborn, if the broker does
  /// not accept a birth of `bytes`: the message would be missing in the order of `seq`.
  bool accepts_birth(std::uint32_t device, std::size_t bytes);

 private:
  struct Device {
    bool is_alive = false;      ///< it answers
    bool is_born = false;       ///< in this session
    bool is_too_large = false;  ///< its birth, for the broker of this session
  };

  void prepare(std::uint32_t index);

  const Config& config_;
  const std::string broker_;
  PrimaryHost host_;
  std::vector<Device> devices_;  ///< as Config::devices
  std::map<std::string, std::uint32_t, std::less<>> index_;
  std::set<std::uint32_t> due_;    ///< devices whose birth or death may be due
  std::vector<std::string> dead_;  ///< names of removed devices whose death is due
  std::uint64_t session_ = 0;
  bool has_connected_ = false;  ///< since begin_session()
  std::size_t max_packet_ = 0;
  bool is_born_ = false;
  bool rebirth_ = false;  ///< a birth of all is due
  bool leaves_ = false;
  SteadyTime born_at_{};
};

}  // namespace fxagent::sparkplug
