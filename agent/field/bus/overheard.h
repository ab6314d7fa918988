// Bytes on the line that belong to no answer: an echo, a late answer, a second one, or another
// master's. Decides what follows from them. Pure: bus and wire report what they receive. Field
// thread.
#pragma once

#include <cstddef>
#include <string>

#include "agent/field/bus/bus_doubt.h"
#include "agent/field/bus/echo.h"
#include "agent/field/bus/exchange.h"
#include "agent/field/bus/late_answers.h"
#include "agent/steady_time.h"
#include "protocol/codec.h"
#include "protocol/value/bytes.h"

namespace fxagent {

/// True if answers carry numbers. A late or repeated answer then never matches another request.
inline bool is_numbered(const Codec& codec) { return codec.after_silence() == Recovery::none; }

/// Bytes on one wire that belong to no answer. judge() updates doubt() and late(); the wire and the
/// bus report everything else to the parts directly.
class Overheard final {
 public:
  /// Number of unexpected bytes that are examined: more than the longest frame of a serial line.
  static constexpr std::size_t kMostJudged = 1024;

  /// `own_ports`: each request may have a port of its own.
  explicit Overheard(bool own_ports) : own_ports_(own_ports) {}

  /// True if a late answer cannot pass for that of a new request: answers carry numbers, or each
  /// request has a port of its own.
  bool tells_answers_apart(const Codec& codec) const { return is_numbered(codec) || own_ports_; }

  /// Judges bytes that are not part of an answer. They may put the bus in doubt. Returns the number
  /// of those that are unexpected: none of an echo.
  std::size_t judge(const Codec& codec, ByteView bytes, SteadyTime now);
  /// True if a whole frame came that does not answer the request of `exchange`: the answers may lag
  /// behind the requests.
  bool is_out_of_step(const Codec& codec, const Exchange& exchange) const;
  /// True if nothing came in place of an answer, except an echo.
  bool is_silence(const Exchange& exchange) const;

  /// Stores the bytes for last_unexpected().
  void keep(ByteView bytes);
  /// Start of the last unexpected bytes, at most 64 of them; empty if there were none.
  const Bytes& last_unexpected() const { return last_unexpected_; }
  /// Returns first_bytes() of them.
  std::string unexpected_text() const;

  /// Records the time of the last byte that came.
  void received(SteadyTime now) { last_received_ = now; }
  /// Time of the last byte that came.
  SteadyTime last_received() const { return last_received_; }

  BusDoubt& doubt() { return doubt_; }
  const BusDoubt& doubt() const { return doubt_; }
  LateAnswers& late() { return late_; }
  Echo& echo() { return echo_; }
  const Echo& echo() const { return echo_; }

 private:
  const bool own_ports_;
  BusDoubt doubt_;
  LateAnswers late_;
  Echo echo_;
  Bytes last_unexpected_;
  SteadyTime last_received_{};
};

}  // namespace fxagent
