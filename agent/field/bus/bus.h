// Serialises requests on one channel and never matches a late answer to a newer request. All access
// to the channel goes through here. On UDP each datagram is judged separately. If the answers carry
// no numbers, each request uses a port of its own; with a fixed port, the channel is treated like a
// serial line. Field thread.
#pragma once

#include <asio/awaitable.hpp>
#include <asio/steady_timer.hpp>
#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "agent/command_message.h"
#include "agent/config/model.h"
#include "agent/config/wiring.h"
#include "agent/field/bus/bus_doubt.h"
#include "agent/field/bus/exchange.h"
#include "agent/field/bus/late_answers.h"
#include "agent/field/bus/wire_trace.h"
#include "agent/field/percentile_window.h"
#include "agent/field/transport/transport.h"
#include "agent/field_health.h"
#include "protocol/codec.h"

namespace fxagent {

/// The properties of a device that the bus needs. Must outlive the await.
struct Station {
  /// Codec of the device, or of the command in progress. A trace shares it until it has explained
  /// its frames.
  std::shared_ptr<const Codec> codec;
  std::string_view device;  ///< its name; empty: unknown
  std::chrono::milliseconds timeout{1000};
  std::chrono::milliseconds gap{0};
  EnquirePolicy enquire = EnquirePolicy::open;
  bool echo = false;               ///< the line echoes what is sent
  Wiring wiring;                   ///< for error texts
  std::uint32_t handshake_in = 0;  ///< Bus::session() of its last answered enquiry; 0: none
  FrameTrace* trace = nullptr;     ///< receives every frame of a command; null for polls
};

class Bus final {
 public:
  struct Counters {
    std::uint64_t exchanges = 0;
    std::uint64_t timeouts = 0;
    std::uint64_t naks = 0;
    std::uint64_t bad_frames = 0;
    std::uint64_t unexpected_bytes = 0;  ///< received when no answer was due, or around one
    std::chrono::nanoseconds busy{0};    ///< in exchanges and in the silence before them
    PercentileWindow turnaround_ms;
    std::unique_ptr<LinkDurations> durations;  ///< null: metrics are off
  };

  /// `char_time` 0: speed unknown. `listening` as in LinkConfig. The transport must be closed.
  Bus(asio::any_io_executor executor, std::unique_ptr<Transport> transport,
      std::chrono::nanoseconds char_time,
      std::chrono::nanoseconds listening = std::chrono::nanoseconds{0});

  /// Opens the channel, then listens until no answer to an earlier session or to a dead agent can
  /// still be on its way. Error: link_down, also if the line does not fall quiet; see
  /// never_silent().
  asio::awaitable<Result<void>> open();
  bool is_open() const { return transport_->is_open(); }
  /// Incremented each time the channel opens. A handshake with a device is valid for one session
  /// only.
  std::uint32_t session() const { return session_; }
  /// Sets how long open() listens. Takes effect at the next open().
  void set_listening(std::chrono::nanoseconds listening) { listening_ = listening; }

  /// Closes the channel and ends what is in progress, including listening and the gap before a
  /// request.
  void close() noexcept {
    timer_.cancel();
    transport_->close();
  }

  /// Sends one request and returns its outcome. Checks `not_after` just before the first byte.
  ///
  /// If the previous exchange left the line in doubt, puts it in order first: listens until no late
  /// answer can come, and enquires unless the station's policy is `never`. After a lost ACK it also
  /// reads a probe. Otherwise enquires as the policy says. If an enquiry goes unanswered, sends
  /// nothing else and returns `unanswered` with `sent` false.
  ///
  /// While the bus is doubted, listens before and after the request. Each silence lasts as long as
  /// the slowest answer may take. A probe with an answer of another length precedes the request.
  /// Data are then marked `doubted`; any other answer is returned as garbled, because it proves
  /// nothing.
  ///
  /// While the bus is wary, sends a read twice and returns the second answer. If a foreign answer
  /// took the place of the first, the second is the device's own.
  asio::awaitable<Exchange> exchange(Station& station, Request request,
                                     SteadyTime not_after = SteadyTime::max());

  /// True if the line echoes requests without being configured to: several consecutive reads came
  /// back. Reset by a read that does not. While true, a command's echo is not taken for its answer.
  bool echo_found() const { return echoes_in_a_row_ >= kEchoesFound; }

  /// Foreign answers found on the bus, and the clean exchanges since.
  const BusDoubt& doubt() const { return bus_doubt_; }
  /// Start of the last unexpected bytes, at most 64 of them; empty if there were none.
  const Bytes& last_unexpected() const { return last_unexpected_; }
  /// True if the channel was closed because bytes came without end, and no request was answered
  /// since.
  bool never_silent() const { return never_silent_; }
  /// True if the channel is UDP.
  bool has_datagrams() const { return transport_->has_datagrams(); }
  /// True if the channel was closed, not by the agent, before anything was answered over it.
  bool closed_unanswered() const { return closed_unanswered_; }
  /// True if anything was answered in the current or last session; or in any session.
  bool was_answered() const { return answered_; }
  bool was_ever_answered() const { return ever_answered_; }
  /// True if the agent has closed the channel after a silence. Only on a new channel can no late
  /// answer pass for that of another request. This is not a loss: call open() again.
  bool closed_after_silence() const { return closed_after_silence_ && !is_open(); }
  /// Returns why the channel is closed, for people.
  std::string_view why_lost() const;

  /// Passes each frame to `trace`; null: tracing is off.
  void trace_to(std::unique_ptr<WireTrace> trace) { trace_ = std::move(trace); }
  bool is_traced() const { return trace_ != nullptr; }

  Counters& counters() { return counters_; }

 private:
  static constexpr int kEchoesFound = 3;
  /// Performs one exchange on a line that is in order, then judges its answer.
  asio::awaitable<Exchange> ask(Station& station, const Request& request, SteadyTime not_after);
  /// Puts the line in order. False: the device did not answer or the channel closed; see `failed`.
  asio::awaitable<bool> prepare(Station& station, const Request& request, Exchange& failed);
  /// Reads something whose answer cannot be an older one. Afterwards no older answer is on its way.
  asio::awaitable<Exchange> probe(const Station& station, const Request& request);
  asio::awaitable<Exchange> send_and_receive(const Codec& codec, const Station& station,
                                             Request request, SteadyTime not_after);
  /// Receives the answer. With `echo`, first removes `sent` from the received bytes.
  asio::awaitable<void> receive(const Codec& codec, const Request& request, const Bytes& sent,
                                bool echo, SteadyTime deadline, Exchange& exchange);
  asio::awaitable<void> close_exchange(const Bytes& closing, bool echo, SteadyTime deadline);
  /// Bytes received while waiting for the line to fall quiet.
  struct Drained {
    Bytes heard;                   ///< the first of them, enough to judge
    std::size_t total = 0;         ///< number of bytes received
    std::optional<Error> error{};  ///< set if the channel is closed, by its peer or as never silent
  };
  /// Listens until `until` and until nothing has come for `quiet`. Closes the channel if that takes
  /// kLongestDrain longer, or after kMostDrained bytes.
  asio::awaitable<Drained> listen(SteadyTime until, std::chrono::nanoseconds quiet);
  /// Same, and counts and judges what came. False: the channel is closed.
  asio::awaitable<bool> drain(const Codec& codec, SteadyTime until, std::chrono::nanoseconds quiet);
  /// Returns the time until which a late answer may come that only silence can rule out.
  SteadyTime late_answers_until(const Station& station) const;
  /// Returns how long the slowest answer on this line may take.
  std::chrono::nanoseconds quiet_in_doubt() const;
  void close_never_silent();
  /// Records that the channel was closed by its peer or by an error.
  void note_lost() { closed_unanswered_ = !answered_; }
  /// True if a late answer cannot pass for that of a new request: answers carry numbers, or each
  /// request has a port of its own.
  bool tells_answers_apart(const Codec& codec) const;
  /// Takes a port for the next request. False: there is none; `failed` says why.
  bool renew_port(const Codec& codec, Exchange& failed);
  /// Discards the previous datagram when a new one has come: it was not an answer.
  void give_up_datagram(const Codec& codec);
  /// Takes what has arrived, without waiting. False: the channel is closed; `failed` says why.
  bool look(const Codec& codec, Exchange& failed);
  /// True if `bytes` are, or may be, an echo. False on a line whose last read had no echo.
  bool may_be_returned(ByteView bytes) const;
  /// Counts bytes that are not part of an answer. They may put the bus in doubt.
  void note_unexpected(const Codec& codec, ByteView bytes);
  /// True if a whole frame came that does not answer the request of `exchange`: the answers may lag
  /// behind the requests.
  bool is_out_of_step(const Codec& codec, const Exchange& exchange) const;
  /// Stores the bytes for last_unexpected().
  void keep_unexpected(ByteView bytes);
  /// Traces the bytes of an exchange. Stores in `exchange` what came in place of an answer.
  void note_heard(const Bytes& frame, SteadyTime deadline, Exchange& exchange) const;
  /// Judges the bytes before and after an answer. With `tells_echo` they show whether the line
  /// echoes requests.
  void note_around_answer(const Codec& codec, const Bytes& sent, const Reply& reply,
                          bool tells_echo);
  /// Judges the answer of an exchange. `findings` and `doubted` are from its beginning.
  asio::awaitable<void> judge(const Codec& codec, std::uint64_t findings, bool doubted,
                              Exchange& exchange);
  asio::awaitable<void> wait_until(SteadyTime at);
  asio::awaitable<void> keep_gap(std::chrono::nanoseconds quiet);
  void note_doubt(const Station& station, const Request& request, const Exchange& exchange);
  SteadyTime now() const { return transport_->now(); }

  std::unique_ptr<Transport> transport_;
  asio::steady_timer timer_;
  const std::chrono::nanoseconds char_time_;
  std::chrono::nanoseconds listening_;
  LateAnswers late_;
  std::uint32_t session_ = 0;
  std::uint16_t tag_ = 0;
  int echoes_in_a_row_ = 0;       ///< consecutive reads whose request came back
  bool returns_nothing_ = false;  ///< nothing came before the answer to the last read
  SteadyTime last_activity_{};    ///< last byte in either direction, as far as known
  SteadyTime not_before_{};       ///< end of a broadcast's turnaround delay
  Bytes rx_;
  BusDoubt bus_doubt_;
  Bytes last_sent_;   ///< last frame or closing; its echo is not foreign
  Bytes unanswered_;  ///< last bytes without an answer; their echo may precede the next answer
  Bytes last_unexpected_;
  std::chrono::nanoseconds slowest_{0};  ///< longest timeout of the stations asked so far
  SteadyTime last_heard_{};
  bool never_silent_ = false;
  bool answered_ = false;  ///< in this session
  bool ever_answered_ = false;
  bool closed_unanswered_ = false;
  bool closed_after_silence_ = false;
  std::unique_ptr<WireTrace> trace_;  ///< null: tracing is off
  Counters counters_;
};

}  // namespace fxagent
