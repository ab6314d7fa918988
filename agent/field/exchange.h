// One question on a bus and how it ended. Values only: whoever judges an answer needs no asio.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>

#include "agent/messages.h"
#include "protocol/codec.h"

namespace fxagent {

/// How one exchange ended.
struct Exchange {
  enum class Outcome : std::uint8_t {
    answered,    ///< `reply` is the device's answer, ACK, NAK or data
    unanswered,  ///< nothing whole came by the deadline
    garbled,     ///< something came that cannot become an answer, or more than one answer
    link_down,   ///< the channel broke; `sent` says whether anything had left
    expired,     ///< `not_after` had passed: nothing was sent
  } outcome = Outcome::unanswered;
  bool sent = false;     ///< at least one byte left the agent
  bool doubted = false;  ///< answered while the bus is doubted, with silence before and behind it
  Reply reply;
  std::string error;                       ///< in words, where not answered
  SteadyTime began{};                      ///< just before the first byte
  SteadyTime ended{};                      ///< last byte of the reply, or when it was given up
  std::int64_t ended_ms = 0;               ///< the same, UTC
  std::chrono::nanoseconds rest{0};        ///< silence that had to lie before it
  std::chrono::nanoseconds turnaround{0};  ///< answered: all that was not characters on the wire
  Bytes heard;  ///< unanswered or garbled: what came in place of an answer
  Bytes asked;  ///< where something was heard: the frame that it came to

  bool has_answer() const { return outcome == Outcome::answered; }
  /// What it took of its line.
  std::chrono::nanoseconds line_time() const { return rest + (ended - began); }
  bool is_ack() const { return has_answer() && reply.kind == Reply::Kind::ack; }
  bool is_nak() const { return has_answer() && reply.kind == Reply::Kind::nak; }
  bool is_data() const { return has_answer() && reply.kind == Reply::Kind::data; }
};

/// What an exchange that brought no data makes of the tags that it was to read.
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
