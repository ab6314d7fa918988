// Publications on their way to the broker: their ids, the window that they share, and the sender
// that gets the outcome of each. Uplink thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <vector>

#include "agent/steady_time.h"
#include "agent/uplink/broker.h"

namespace fxagent {

class Outgoing final {
 public:
  /// Hands publications over, and gets the outcome of each once, unless the connection ends first.
  class Sender {
   public:
    virtual ~Sender() = default;
    virtual void delivered(std::uint64_t id, SteadyTime now) = 0;
    virtual void failed(const DeliveryFailed& event, SteadyTime now) = 0;
  };

  explicit Outgoing(Broker& broker) : broker_(broker) {}

  /// Begins a connection with the limits of its broker.
  void begin(const Connected& connected);
  /// Ends the connection. Senders get no outcome of what was in flight.
  void forget();

  /// Returns the publication's id, which its sender gets with the outcome. If the broker would
  /// close the connection because of it, it is not sent and fails with the next fail_unsendable().
  std::uint64_t send(Sender& sender, Publication publication);
  /// Returns true if something failed.
  bool fail_unsendable(SteadyTime now);

  void on(const Delivered& event, SteadyTime now);
  void on(const DeliveryFailed& event, SteadyTime now);
  /// Call at the end of each step in which something may have been sent.
  void note_sent(SteadyTime now);

  /// True if the broker accepts a packet of this size.
  bool fits(const Publication& publication) const;
  /// Number of publications that may be unacknowledged: the broker's figure, limited to what the
  /// library handles fast.
  std::size_t window() const { return window_; }
  bool has_room() const { return flights_.size() < window_; }
  /// True if the window is too small to keep places free.
  bool is_small() const { return window_ <= kSmallWindow; }
  /// True if a sample may be sent. In a window that is not small two places stay free, so that a
  /// result or a state never waits behind samples.
  bool has_room_for_samples() const {
    return flights_.size() < (is_small() ? window_ : window_ - 2);
  }
  std::size_t size() const { return flights_.size(); }
  bool empty() const { return flights_.empty(); }
  /// Time since which the broker has owed an answer: that of the first message, or of its last
  /// answer.
  std::optional<SteadyTime> unanswered_since() const { return unanswered_since_; }

 private:
  struct Flight {
    Sender* sender = nullptr;
    bool expects_puback = true;  ///< QoS 0 is complete when handed to the socket
  };

  static constexpr std::size_t kSmallWindow = 4;

  void note_answer(const Flight& flight, SteadyTime now);

  Broker& broker_;
  std::uint64_t next_id_ = 1;
  std::map<std::uint64_t, Flight> flights_;
  std::vector<DeliveryFailed> unsendable_;
  std::size_t window_ = 0;
  std::size_t max_packet_ = std::numeric_limits<std::size_t>::max();
  bool handed_over_ = false;  ///< a message went to the library in this step
  std::optional<SteadyTime> unanswered_since_;
};

}  // namespace fxagent
