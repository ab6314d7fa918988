// Whether the primary host application is online, by its STATE messages (Sparkplug 3.0, section
// 5.4). Uplink thread. Pure.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace fxagent::sparkplug {

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

}  // namespace fxagent::sparkplug
