// Publications on their way to the broker: their ids, the window that they share, and the sender
// that gets the outcome of each. Several may be sent as one, with one outcome.
//
// A QoS 0 message has no acknowledgement. To prove its delivery, a session with a marker topic
// publishes an empty QoS 1 message (the marker) after it. Brokers handle the packets of a
// connection in order, so everything sent before an acknowledged marker has arrived. Uplink thread.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "agent/log/log.h"
#include "agent/steady_time.h"
#include "agent/uplink/broker.h"

namespace fxagent {

/// Per step: on() each outcome, send() while has_room(), note_sent(), fail_unsendable().
class Outgoing final {
 public:
  /// Gets delivered() or failed() once for each id that it was given by send() or send_group();
  /// neither if the connection ends first.
  class Sender {
   public:
    virtual ~Sender() = default;
    virtual void delivered(std::uint64_t id, SteadyTime now) = 0;
    virtual void failed(const DeliveryFailed& event, SteadyTime now) = 0;
  };

  /// Time in which an acknowledgement is processed if nothing else wakes the uplink.
  static constexpr std::chrono::milliseconds kAcknowledgedWithin{50};

  /// `marker_topic` gets the markers; empty: a QoS 0 message is delivered when the socket has it.
  explicit Outgoing(Broker& broker, std::string marker_topic = {})
      : broker_(broker), marker_topic_(std::move(marker_topic)) {}

  /// Begins a connection with the limits of its broker.
  void begin(const Connected& connected);
  /// Ends the connection. Senders get no outcome of what was in flight.
  void forget();

  /// Hands the publication over at once, even beyond the window: ask has_room() first. Returns its
  /// id, which its sender gets with the outcome. If the broker would close the connection because
  /// of it, it is not sent and fails with the next fail_unsendable().
  std::uint64_t send(Sender& sender, Publication publication);
  /// Sends publications, at least one, in order, under one id. They are delivered when all are, and
  /// fail when one has failed. Two or more wait for room; a single one is handed over as above.
  std::uint64_t send_group(Sender& sender, std::vector<Publication> publications);
  /// Calls Sender::failed() for what could not be sent. Returns true if something failed.
  bool fail_unsendable(SteadyTime now);

  /// Passes the outcome to the sender of the publication.
  void on(const Delivered& event, SteadyTime now);
  void on(const DeliveryFailed& event, SteadyTime now);
  /// Drops what waits for room; its senders get no outcome. Call before the last messages.
  void drop_waiting() { waiting_.clear(); }
  /// Call at the end of each step in which something may have been sent.
  void note_sent(SteadyTime now);

  /// True if the broker accepts a packet of this size.
  bool fits(const Publication& publication) const;
  /// Number of publications that may be unacknowledged: the broker's figure, limited to what the
  /// library handles fast.
  std::size_t window() const { return window_; }
  bool has_room() const { return size() < window_; }
  /// True if the window is too small to keep places free.
  bool is_small() const { return window_ <= kSmallWindow; }
  /// True if a sample may be sent. In a window that is not small two places stay free, so that a
  /// result or a state never waits behind samples.
  bool has_room_for_samples() const { return size() < (is_small() ? window_ : window_ - 2); }
  std::size_t size() const { return flights_.size() + waiting_.size(); }
  bool empty() const { return size() == 0; }
  /// Time since which the broker owes an answer: that of the first message, or of its last answer.
  std::optional<SteadyTime> unanswered_since() const { return unanswered_since_; }

 private:
  struct Flight {
    Sender* sender = nullptr;
    bool expects_puback = true;  ///< false: QoS 0
    std::uint64_t group = 0;     ///< 0: it was sent alone
    std::uint64_t turn = 0;      ///< place in the order of hand-over
  };
  /// Publications with one outcome.
  struct Group {
    std::size_t open = 0;  ///< without an outcome of their own
    std::optional<DeliveryFailed> failure{};
  };
  struct Waiting {
    Flight flight;
    Publication publication;
  };

  static constexpr std::size_t kSmallWindow = 4;

  /// Gives the publication to the library and makes it a flight.
  void hand_over(Flight flight, Publication publication);
  void send_waiting();
  void note_answer(const Flight& flight, SteadyTime now);
  void ended(std::uint64_t id, const Flight& flight, const DeliveryFailed* failure, SteadyTime now);
  void marked(SteadyTime now);

  Broker& broker_;
  const std::string marker_topic_;
  std::uint64_t next_id_ = 1;
  std::map<std::uint64_t, Flight> flights_;  ///< by publication id
  std::map<std::uint64_t, Group> groups_;    ///< by the id that their sender has
  std::deque<Waiting> waiting_;              ///< for room
  std::uint64_t turns_ = 0;                  ///< number of hand-overs
  std::uint64_t last_unproven_ = 0;          ///< turn of the last QoS 0 message
  std::uint64_t marker_ = 0;                 ///< id of the marker in flight; 0: none
  std::uint64_t marker_turn_ = 0;            ///< it proves the delivery of smaller turns
  std::vector<DeliveryFailed> unsendable_;
  std::size_t window_ = 0;
  std::size_t max_packet_ = std::numeric_limits<std::size_t>::max();
  bool handed_over_ = false;  ///< a message went to the library in this step
  std::optional<SteadyTime> unanswered_since_;
};

/// Logs that a publication failed. `what` it was: a state, a result, the name of a profile. `more`:
/// fields that say which one.
template <class... More>
void log_failed(std::string_view what, const DeliveryFailed& event, const More&... more) {
  log::warn(event.reason_code != 0 ? "publish_refused" : "publish_failed",
            {{"what", std::string(what)},
             more...,
             {"code", hex_code(event.reason_code)},
             {"reason", event.text}});
}

}  // namespace fxagent
