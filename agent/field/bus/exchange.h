// One request on a bus and its outcome. Values only: code that judges answers does not need asio.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>
#include <utility>

#include "agent/handover/telemetry.h"
#include "agent/steady_time.h"
#include "protocol/codec.h"

namespace fxagent {

/// Pause before a busy device is asked again.
inline constexpr std::chrono::milliseconds kBusyPause{100};

/// Outcome of one exchange.
struct Exchange {
  enum class Outcome : std::uint8_t {
    answered,    ///< `reply` is the device's answer, ACK, NAK or data
    unanswered,  ///< no complete answer by the deadline
    garbled,     ///< what came cannot become an answer, or was more than one
    link_down,   ///< the channel broke; `sent` is true if anything had left
    expired,     ///< `not_after` had passed: nothing was sent
  } outcome = Outcome::unanswered;
  bool sent = false;     ///< at least one byte left the agent
  bool doubted = false;  ///< answered while the bus was doubted, with silence before and after
  Reply reply;
  std::string error;                       ///< why it was not answered, in words
  SteadyTime began{};                      ///< just before the first byte
  SteadyTime ended{};                      ///< last byte of the reply, or when the agent gave up
  std::int64_t ended_ms = 0;               ///< the same, UTC
  std::chrono::nanoseconds rest{0};        ///< silence required before it, and its enquiry
  std::chrono::nanoseconds turnaround{0};  ///< answered: time beyond that of the characters
  Bytes received;                          ///< unanswered or garbled: bytes in place of an answer
  Bytes asked;                             ///< request frame that `received` came after

  /// Returns an exchange that ended before anything was sent. It took no line time.
  static Exchange unsent(Outcome how, std::string why) {
    Exchange exchange;
    exchange.outcome = how;
    exchange.error = std::move(why);
    return exchange;
  }

  bool has_answer() const { return outcome == Outcome::answered; }
  /// Returns the line time that it used.
  std::chrono::nanoseconds line_time() const { return rest + (ended - began); }
  bool is_ack() const { return has_answer() && reply.kind == Reply::Kind::ack; }
  bool is_nak() const { return has_answer() && reply.kind == Reply::Kind::nak; }
  bool is_data() const { return has_answer() && reply.kind == Reply::Kind::data; }
};

/// Returns the reason why the tags of an exchange without data are bad.
inline BadReason bad_reason(const Exchange& exchange) {
  if (exchange.is_nak()) return BadReason::nak;
  switch (exchange.outcome) {
    case Exchange::Outcome::unanswered:
      return BadReason::timeout;
    case Exchange::Outcome::link_down:
      return BadReason::link_down;
    default:
      return BadReason::bad_frame;
  }
}

}  // namespace fxagent
