// Publications that are on their way to the broker: their ids, the window that they share, and who
// is to learn what became of each. Uplink thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <vector>

#include "agent/messages.h"
#include "agent/uplink/broker.h"

namespace fxagent {

class Outgoing final {
 public:
  /// Who hands publications over. Of each it learns the end, once, unless the connection ends
  /// first.
  class Sender {
   public:
    virtual ~Sender() = default;
    virtual void delivered(std::uint64_t id, SteadyTime now) = 0;
    virtual void failed(const DeliveryFailed& event, SteadyTime now) = 0;
  };

  explicit Outgoing(Broker& broker) : broker_(broker) {}

  /// A new connection, and what its broker takes.
  void begin(const Connected& connected);
  /// The connection is over. Nobody learns any more what became of what was on its way.
  void forget();

  /// The publication's id, which its sender will be told. What the broker would close the
  /// connection for fails with the next fail_unsendable().
  std::uint64_t send(Sender& sender, Publication publication);
  /// Whether something failed.
  bool fail_unsendable(SteadyTime now);

  void on(const Delivered& event, SteadyTime now);
  void on(const DeliveryFailed& event, SteadyTime now);
  /// At the end of a step in which something may have been sent.
  void note_sent(SteadyTime now);

  /// Whether the broker takes a packet of that size.
  bool fits(const Publication& publication) const;
  /// So many may be unacknowledged: the broker's figure, and no more than the library is fast with.
  std::size_t window() const { return window_; }
  bool has_room() const { return flights_.size() < window_; }
  std::size_t size() const { return flights_.size(); }
  bool empty() const { return flights_.empty(); }
  /// Since when the broker owes an answer: the first message, or its last answer.
  std::optional<SteadyTime> unanswered_since() const { return unanswered_since_; }

 private:
  struct Flight {
    Sender* sender = nullptr;
    bool expects_puback = true;  ///< QoS 0 is over when it was handed to the socket
  };

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
