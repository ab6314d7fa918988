// Bytes on the line that belong to no answer: an echo, a late answer, a second one, or another
// master's. Decides what follows from them. Pure: bus and wire report what they receive. Field
// thread.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <string>

#include "agent/field/bus/exchange.h"
#include "agent/steady_time.h"
#include "protocol/codec.h"
#include "protocol/value/bytes.h"

namespace fxagent {

/// Tracks whether the answers on one wire can be trusted. Unexpected bytes may be a second answer
/// to a request, or another master's. The next answer may then be foreign too, and a value or an
/// ACK would be wrong with good quality. The bus is doubted from the first such bytes until several
/// consecutive exchanges were clean.
class BusDoubt final {
 public:
  /// Consecutive clean exchanges that end a doubt. A doubt that begins within kRelapse of the end
  /// of the last one needs twice as many as that, at most kMostExchanges.
  static constexpr std::uint32_t kCleanExchanges = 3;
  static constexpr std::uint32_t kMostExchanges = 12;
  static constexpr std::chrono::seconds kRelapse{60};

  /// Records unexpected bytes that may pass for an answer.
  void found_foreign(SteadyTime now);
  /// Records a frame in place of an answer, or more bytes than the late answer that was owed. The
  /// bus puts itself in order after either, so this makes it wary and not doubted.
  void was_out_of_step(SteadyTime now) { wary_until_ = now + kRelapse; }
  /// Records an answered request with silence before it and after its answer, each as long as the
  /// slowest answer may take.
  void exchange_was_clean(SteadyTime now);
  /// Records a request that was not answered cleanly. Silence does not count: a device that is
  /// switched off must not keep its whole line in doubt.
  void exchange_was_unclear();

  bool is_doubted() const { return exchanges_to_go_ > 0; }
  /// True if foreign bytes were found, or the bus was out of step, within the last kRelapse. The
  /// next answer may be foreign too: every read should be sent twice.
  bool is_wary(SteadyTime now) const { return now < wary_until_; }
  /// Returns how often foreign bytes were found. After a change of this number, an answer may
  /// belong to an earlier request.
  std::uint64_t findings() const { return findings_; }
  /// Returns how often the bus became doubted.
  std::uint64_t doubts() const { return doubts_; }

 private:
  std::uint64_t findings_ = 0;
  std::uint64_t doubts_ = 0;
  std::uint32_t exchanges_to_go_ = 0;
  std::uint32_t wanted_ = kCleanExchanges;
  SteadyTime wary_until_{};
  SteadyTime ended_{};  ///< end of the last doubt
};

/// Tracks answers that may still arrive after their requests were given up. A late answer without a
/// number would pass for the answer to the next request.
class LateAnswers final {
 public:
  /// The kind of answer still owed. An ACK outweighs data: it has no address, so a late one may
  /// arrive until a read sent after it has been answered.
  enum class Owed : std::uint8_t { none, data, acknowledgement };

  /// A late answer may exceed its device's `timeout_ms` by as much again, within these limits.
  static constexpr std::chrono::milliseconds kLeast{100};
  static constexpr std::chrono::milliseconds kMost{5000};

  /// Records a request that was given up at `ended` without a good answer. `timeout` is its
  /// device's; `bytes` the length of its answer.
  void given_up(Owed answer, SteadyTime ended, std::chrono::milliseconds timeout,
                std::uint32_t bytes) {
    owed_ = std::max(owed_, answer);
    owed_bytes_ += bytes;
    over_at_ = std::max(over_at_, ended + std::clamp(timeout, kLeast, kMost));
  }
  /// Records that no older answer can be on its way any more.
  void settled() {
    owed_ = Owed::none;
    owed_bytes_ = came_ = 0;
  }
  Owed owed() const { return owed_; }
  /// Records bytes that came while an answer is owed. Returns true if more came than is owed.
  bool came(std::size_t bytes) { return (came_ += bytes) > owed_bytes_; }
  /// Returns the time after which no owed answer can come.
  SteadyTime over_at() const { return over_at_; }

  /// Returns the number for Codec::probe(): the answer differs from that of every probe that may
  /// still be answered.
  std::uint32_t probe() const { return probe_; }
  /// Records that the probe got no data. Its answer may still come, so the next probe must differ.
  void probe_failed() { ++probe_; }

 private:
  Owed owed_ = Owed::none;
  std::size_t owed_bytes_ = 0;
  std::size_t came_ = 0;
  SteadyTime over_at_{};
  std::uint32_t probe_ = 0;
};

/// Recognises a line that returns every byte sent on it, without being configured to: an adapter of
/// a two-wire line with its receiver on.
class Echo final {
 public:
  /// True if several consecutive reads came back. A read that does not come back resets it. While
  /// true, a command's echo is not taken for its answer.
  bool is_found() const { return in_a_row_ >= kFound; }

  void sent(const Bytes& frame) { last_sent_ = frame; }
  /// Records that no answer follows what was sent: its echo may precede the next answer.
  void sent_unanswered(const Bytes& bytes) { last_sent_ = unanswered_ = bytes; }
  /// Returns `before`, the bytes received before an answer to `request`, without its echo. `shows`:
  /// `request` is a read whose echo was not removed earlier, so `before` shows if the line echoes.
  Bytes answered(Bytes before, const Bytes& request, bool shows);
  /// Records that an answer has come since sent_unanswered().
  void forget_unanswered() { unanswered_.clear(); }

  /// True if `bytes` are, or may be, an echo. False on a line whose last read had no echo.
  bool may_be(ByteView bytes) const;

 private:
  static constexpr int kFound = 3;

  int in_a_row_ = 0;              ///< consecutive reads whose request came back
  bool returns_nothing_ = false;  ///< nothing came before the answer to the last read
  Bytes last_sent_;               ///< last frame or closing
  Bytes unanswered_;              ///< last bytes without an answer
};

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
