// The common part of the two Sparkplug profiles: topics, the births and deaths of the node and its
// devices in the order in which a host needs them, and the state of the primary host. Uplink
// thread. Time is an argument.
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

#include "agent/uplink/profile/profile.h"

namespace fxagent::sparkplug {

/// Returns the index of the tag with this name; nullopt: there is none. Begins at `from` and goes
/// round: the tags of a sample follow each other in the order of the config.
std::optional<std::size_t> place_of(const SharedVector<TagConfig>& tags, std::string_view name,
                                    std::size_t from = 0);

/// Tracks from STATE messages if the primary host application is online (Sparkplug 3.0, section
/// 5.4). Pure, except for the log. Uplink thread.
class PrimaryHost final {
 public:
  /// `topic` is that of its state; empty: no host is waited for. `old_state`: the state is ONLINE
  /// or OFFLINE, as before Sparkplug 3.0.
  PrimaryHost(std::string topic, bool old_state);

  const std::string& topic() const { return topic_; }
  /// Nothing is known of it in a new session.
  void connection_began() {
    online_.reset();
    last_ = last_online_ = 0;
  }
  /// Processes a text on topic().
  void hear(std::string_view payload);

  /// True if births and data may be published.
  bool is_online() const { return topic_.empty() || online_.value_or(false); }
  /// True if it has said so in this session.
  bool is_offline() const { return !online_.value_or(true); }

 private:
  void set(bool online, std::int64_t timestamp);

  std::string topic_;
  bool old_state_;
  std::optional<bool> online_;  ///< nullopt: not known
  // Timestamps in this session, in the host's unit.
  std::int64_t last_ = 0;         ///< of the last state
  std::int64_t last_online_ = 0;  ///< of the last one with which it was online
};

/// The part of a profile that is the same for both payloads.
class EdgeNode : public Profile {
 public:
  /// Begins a session, whose number rises only if a connection came about since the last call.
  Publication last_will() override;
  void connection_began(const Connected& connected) override;
  void connection_ended() override { is_born_ = false; }
  void device_state(const DeviceStatus& status) override;
  void change(const ConfigChange& change) override;
  /// Returns births and deaths in their order: while the host is offline none are due.
  std::vector<Publication> due(SteadyTime now, std::int64_t utc_ms) override;
  std::vector<Publication> farewell(std::int64_t utc_ms) override;
  SteadyTime next_wake() const override;
  /// True if the node is born in this session, and is not to be born again.
  bool is_ready() const override { return is_born_ && !rebirth_; }
  /// True, once, if the host is offline.
  bool take_server_change() override;
  void due_was_refused() override { request_rebirth(); }
  /// A device that does not answer has no metrics: its samples wait until it does.
  bool may_send(const std::string& device) const override;

 protected:
  /// Shortest time between two rebirths.
  static constexpr std::chrono::seconds kRebirthEvery{1};

  /// `config` outlives it. `version`: first level of its topics. `utc_ms`: current calendar time.
  EdgeNode(const Config& config, const ProfileConfig& profile, const std::string& version,
           PrimaryHost host, RelayCommand relay, std::function<std::int64_t()> utc_ms);

  /// Returns the message of this type; `device` is empty for those of the node.
  Publication message(std::string_view type, const std::string& device, std::string payload) const;
  /// Returns the death of the node in this session, which is also its last will.
  virtual Publication node_death(std::int64_t utc_ms) const = 0;
  virtual Publication node_birth(SteadyTime now, std::int64_t utc_ms) = 0;
  /// Returns nullopt if accepts_birth() is false.
  virtual std::optional<Publication> device_birth(std::uint32_t index, std::int64_t utc_ms) = 0;
  virtual Publication device_death(const std::string& name, std::int64_t utc_ms) = 0;

  /// Processes a message if it is on the topic of the primary host. Returns false if it is not.
  bool hear_host(const Message& message);
  /// Makes due() repeat all births, at most once a second.
  void request_rebirth() { rebirth_ = true; }
  /// Returns the devices that are born since the last birth of the node.
  std::vector<std::uint32_t> born() const;
  std::optional<std::uint32_t> index_of(std::string_view device) const;
  /// Returns the longest payload that the broker accepts, in bytes.
  std::size_t most_bytes() const;
  /// Returns false, reports that once a session and leaves the device unborn, if the broker does
  /// not accept a birth of `bytes`: the message would be missing in the order of `seq`.
  bool accepts_birth(std::uint32_t device, std::size_t bytes);

  const PrimaryHost& host() const { return host_; }
  /// Number of the session, from 0.
  std::uint64_t session() const { return session_; }

  const Config& config_;
  const std::string name_;
  const std::string prefix_;  ///< "{version}/{group}/"
  const std::string node_;
  const RelayCommand relay_;
  const std::function<std::int64_t()> utc_ms_;

 private:
  struct Life {
    bool is_alive = false;      ///< it answers
    bool is_born = false;       ///< since the node's last birth
    bool is_too_large = false;  ///< its birth, for the broker of this session
  };

  const std::string broker_;
  PrimaryHost host_;
  std::vector<Life> lives_;  ///< of the devices, as Config::devices
  std::map<std::string, std::uint32_t, std::less<>> index_;
  std::set<std::uint32_t> due_;    ///< devices whose birth or death may be due
  std::vector<std::string> dead_;  ///< names of removed devices whose death is due
  std::uint64_t session_ = 0;
  bool has_connected_ = false;  ///< since last_will()
  std::size_t max_packet_ = 0;
  bool is_born_ = false;
  bool rebirth_ = false;  ///< a birth of all is due
  bool leaves_ = false;
  SteadyTime born_at_{};
};

}  // namespace fxagent::sparkplug
