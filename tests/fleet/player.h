// One played agent with one device. Connects, subscribes and publishes as fxagent does: retained
// states after each connect, samples, health, results, and the samples of an outage as history.
// Pure but for its connection: time is an argument.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <random>
#include <string>
#include <vector>

#include "tests/fleet/connection.h"
#include "tests/fleet/figures.h"
#include "tests/fleet/reconnect.h"

namespace fxfleet {

/// Properties that all players share.
struct Plan {
  std::vector<asio::ip::tcp::endpoint> servers;
  Mqtt version = Mqtt::v5;
  std::string root = "fx/fleet";
  int qos = 1;                 ///< of samples
  bool keeps_session = false;  ///< the agent does not
  milliseconds interval{1000};
  milliseconds spread{0};  ///< mqtt.reconnect_spread_s
};

class Player final {
 public:
  /// `plan` and `figures` outlive the player.
  Player(asio::io_context& io, const Plan& plan, Figures& figures, unsigned number);

  /// Begins to connect for the first time.
  void start(Time now);
  /// Does what is due. Call at least at next_wake() and after each start().
  void step(Time now);
  Time next_wake() const;
  /// Makes no more samples.
  void stop_samples() { makes_samples_ = false; }
  /// Disconnects with a DISCONNECT.
  void leave();

  bool is_connected() const { return link_ == Link::connected; }
  bool is_under_way() const { return link_ == Link::connecting || link_ == Link::greeting; }
  /// True if the broker has acknowledged all messages.
  bool is_done() const { return flights_.empty() && due_.empty() && backlog_.empty(); }
  /// True if samples of an outage have not all been acknowledged.
  bool has_backlog() const { return !backlog_.empty() || history_in_flight_ > 0; }
  std::string command_topic() const { return base_ + "/press1/command"; }

  /// Called when next_wake() may have become earlier.
  std::function<void()> woken;

 private:
  /// greeting: CONNECT was sent, CONNACK is awaited.
  enum class Link : std::uint8_t { idle, waiting, connecting, greeting, connected };
  /// A message of QoS 1 on its way. `samples`: their sequence numbers and times.
  struct Row {
    std::uint64_t seq;
    std::int64_t ts;
  };
  struct Message {
    Publish publish;
    std::vector<Row> samples;
    std::string result_of;  ///< id of a command
    bool is_history = false;
  };
  struct Flight {
    Message message;
    Time sent;
  };

  void opened();
  void received(const Packet& packet);
  void ended();
  void connack(const Packet& packet, Time now);
  void lost(Time now);
  void command(const Packet& packet);
  void pump(Time now);
  void send(Message message, Time now);
  Message next_history();
  Message result_message(const std::string& id, bool is_duplicate) const;
  Message retained(const std::string& topic, std::string payload) const;
  std::uint16_t next_id();

  const Plan& plan_;
  Figures& figures_;
  const std::string name_;
  const std::string base_;
  const std::string boot_;
  const std::size_t first_server_;  ///< the configs of a fleet begin with different servers
  const asio::ip::address_v4 source_;
  const std::int64_t started_ms_;
  Connection connection_;
  Reconnect reconnect_;
  std::minstd_rand random_;

  Link link_ = Link::idle;
  Time retry_at_{};
  Time deadline_{};  ///< of the attempt to connect
  Time sent_at_{};   ///< last packet, for the keep alive
  Time sample_at_{};
  Time health_at_{};
  bool makes_samples_ = true;
  std::size_t window_ = 20;
  std::uint16_t last_id_ = 0;
  std::uint64_t seq_ = 0;
  std::deque<Message> due_;  ///< states and results that wait for the window
  std::size_t history_in_flight_ = 0;
  std::vector<Row> backlog_;  ///< samples that were not acknowledged
  std::map<std::uint16_t, Flight> flights_;
  std::deque<std::string> commands_;  ///< ids of the last commands
};

}  // namespace fxfleet
