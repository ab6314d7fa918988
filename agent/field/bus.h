// The discipline of one wire: one question at a time, and no late answer taken for a new one. On
// UDP each datagram is judged by itself; where answers have no numbers a question is asked from a
// port of its own, or, where the port is fixed, the wire is treated as a serial one. Everything
// that touches the channel goes through here. Field thread.
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

#include "agent/config/config.h"
#include "agent/config/wiring.h"
#include "agent/field/bus_doubt.h"
#include "agent/field/exchange.h"
#include "agent/field/late_answers.h"
#include "agent/field/percentile_window.h"
#include "agent/field/transport.h"
#include "agent/field/wire_trace.h"
#include "agent/messages.h"
#include "protocol/codec.h"

namespace fxagent {

/// What the line must know of the device it speaks to. Lives as long as the await.
struct Station {
  /// Of the device, or of the command that is carried out; a trace keeps it while it explains.
  std::shared_ptr<const Codec> codec;
  std::string_view device;  ///< its name; empty: not known
  std::chrono::milliseconds timeout{1000};
  std::chrono::milliseconds gap{0};
  EnquirePolicy enquire = EnquirePolicy::open;
  bool echo = false;               ///< the line returns what is sent
  Wiring wiring;                   ///< for texts
  std::uint32_t handshake_in = 0;  ///< Bus::session() in which it last answered an enquiry; 0: none
  FrameTrace* trace = nullptr;     ///< takes every frame of a command; null for polls
};

class Bus final {
 public:
  struct Counters {
    std::uint64_t exchanges = 0;
    std::uint64_t timeouts = 0;
    std::uint64_t naks = 0;
    std::uint64_t bad_frames = 0;
    std::uint64_t unexpected_bytes = 0;  ///< that came when no answer, or no more of it, was due
    std::chrono::nanoseconds busy{0};    ///< in exchanges, and in the silence that they waited for
    PercentileWindow turnaround_ms;
    std::unique_ptr<LinkDurations> durations;  ///< null: the config asks for no metrics
  };

  /// `char_time` 0: speed unknown. `listening` as in LinkConfig. The transport is closed.
  Bus(asio::any_io_executor executor, std::unique_ptr<Transport> transport,
      std::chrono::nanoseconds char_time,
      std::chrono::nanoseconds listening = std::chrono::nanoseconds{0});

  /// Opens the channel and listens, so that no answer to an earlier session's question, or to a
  /// dead agent's, is still on its way when the first one is asked. link_down also where the line
  /// does not fall quiet: never_silent().
  asio::awaitable<Result<void>> open();
  bool is_open() const { return transport_->is_open(); }
  /// Rises with every open(): what was agreed with a device holds for one session only.
  std::uint32_t session() const { return session_; }
  /// How long it listens before the first question, from the next open() on.
  void set_listening(std::chrono::nanoseconds listening) { listening_ = listening; }

  /// Ends what is under way, listening and a gap before a request included.
  void close() noexcept {
    timer_.cancel();
    transport_->close();
  }

  /// One question and its answer. Puts the line in order first where the last exchange left it in
  /// doubt (listen until no late answer can come, enquire, and after a lost ACK a probing read),
  /// and enquires as the station's policy says; if that goes unanswered nothing else is sent:
  /// unanswered with `sent` false. `not_after` is checked just before the first byte. While the bus
  /// is doubted it listens until nothing has come for as long as the slowest answer may take, asks
  /// something whose answer can be told apart, asks, and listens again. Then data are marked
  /// `doubted`, and any other answer is garbled: nothing is known by it. While the bus is wary a
  /// read is asked twice, and the second answer is taken: where a foreign one came in place of the
  /// first, that is the question's own.
  asio::awaitable<Exchange> exchange(Station& station, Request request,
                                     SteadyTime not_after = SteadyTime::max());

  /// Whether questions come back before their answers on a line that is not said to do so: some
  /// reads in a row did. Until one does not, a command's echo is not taken for its answer.
  bool echo_found() const { return echoes_in_a_row_ >= kEchoesFound; }

  /// Whether foreign answers were heard, and since when too few clean exchanges.
  const BusDoubt& doubt() const { return bus_doubt_; }
  /// The last bytes that nobody asked for, the first ones of them; empty while there were none.
  const Bytes& last_unexpected() const { return last_unexpected_; }
  /// The channel was closed because bytes came without end, and no question was answered since.
  bool never_silent() const { return never_silent_; }
  /// Whether the channel is UDP.
  bool has_datagrams() const { return transport_->has_datagrams(); }
  /// The channel was closed, not by the agent, before anything was answered over it.
  bool closed_unanswered() const { return closed_unanswered_; }
  /// Whether anything was answered in the session, open or not any more; or in any.
  bool was_answered() const { return answered_; }
  bool was_ever_answered() const { return ever_answered_; }
  /// The agent itself has closed the channel behind a silence, since only on a new one no late
  /// answer is taken for that of another question. Nothing is lost: open() again.
  bool closed_after_silence() const { return closed_after_silence_ && !is_open(); }
  /// For a person: what became of a channel that is not open any more.
  std::string_view why_lost() const;

  /// From now on each frame is shown; null: none is.
  void trace_to(std::unique_ptr<WireTrace> trace) { trace_ = std::move(trace); }
  bool is_traced() const { return trace_ != nullptr; }

  Counters& counters() { return counters_; }

 private:
  static constexpr int kEchoesFound = 3;
  /// One exchange on a line that is in order, and what the doubt makes of it.
  asio::awaitable<Exchange> ask(Station& station, const Request& request, SteadyTime not_after);
  /// False when the device did not answer; then `failed` tells how.
  asio::awaitable<bool> prepare(Station& station, const Request& request, Exchange& failed);
  /// Reads something whose answer no older one can be taken for; then none is on its way.
  asio::awaitable<Exchange> probe(const Station& station, const Request& request);
  asio::awaitable<Exchange> send_and_receive(const Codec& codec, const Station& station,
                                             Request request, SteadyTime not_after);
  /// `sent` is what left; it is taken off the front of what comes where the line returns it.
  asio::awaitable<void> receive(const Codec& codec, const Request& request, const Bytes& sent,
                                bool echo, SteadyTime deadline, Exchange& exchange);
  asio::awaitable<void> close_exchange(const Bytes& closing, bool echo, SteadyTime deadline);
  /// What came while a line was to fall quiet.
  struct Drained {
    Bytes heard;                   ///< the first bytes of it, as many as are judged
    std::size_t total = 0;         ///< bytes
    std::optional<Error> error{};  ///< the channel is closed, by its peer or as never silent
  };
  /// Listens until `until`, and until nothing has come for `quiet`; gives up kLongestDrain later,
  /// and after kMostDrained bytes.
  asio::awaitable<Drained> listen(SteadyTime until, std::chrono::nanoseconds quiet);
  /// The same, and counts and judges what came. False: the channel is closed.
  asio::awaitable<bool> drain(const Codec& codec, SteadyTime until, std::chrono::nanoseconds quiet);
  /// Before this time a late answer may still come, and nothing but silence tells that none does.
  SteadyTime late_answers_until(const Station& station) const;
  /// As long as the slowest answer on this line may take.
  std::chrono::nanoseconds quiet_in_doubt() const;
  void close_never_silent();
  /// What was open is closed, not by the agent.
  void note_lost() { closed_unanswered_ = !answered_; }
  /// No late answer is taken for that of a new question: they carry numbers, or each question has a
  /// port of its own.
  bool tells_answers_apart(const Codec& codec) const;
  /// The port for the next question. False: there is none; `failed` says why.
  bool renew_port(const Codec& codec, Exchange& failed);
  /// A new datagram has come: the one before it was no answer.
  void give_up_datagram(const Codec& codec);
  /// Takes what has arrived without waiting. False: the channel is closed; `failed` says why.
  bool look(const Codec& codec, Exchange& failed);
  /// Whether they are, or may be, what was sent: not on a line that has just shown to return
  /// nothing.
  bool may_be_returned(ByteView bytes) const;
  /// Bytes that are no part of an answer: counted, and a reason to doubt the bus.
  void note_unexpected(const Codec& codec, ByteView bytes);
  /// For last_unexpected().
  void keep_unexpected(ByteView bytes);
  /// What an exchange brought goes to the trace, and what it brought in place of an answer into it.
  void note_heard(const Bytes& frame, SteadyTime deadline, Exchange& exchange) const;
  /// What came before and behind an answer. With `tells_echo` the answer shows whether the line
  /// returns questions.
  void note_around_answer(const Codec& codec, const Bytes& sent, const Reply& reply,
                          bool tells_echo);
  /// What the doubt makes of an exchange that began when so many foreign bytes were found.
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
  int echoes_in_a_row_ = 0;       ///< reads whose question came back
  bool returns_nothing_ = false;  ///< the last read had nothing before its answer
  SteadyTime last_activity_{};    ///< last byte in either direction, as far as it can be known
  SteadyTime not_before_{};       ///< a broadcast's turnaround delay
  Bytes rx_;
  BusDoubt bus_doubt_;
  Bytes last_sent_;   ///< the last frame or closing: an echo of it is not foreign
  Bytes unanswered_;  ///< what was sent last and nobody answers: its echo may stand before the next
  Bytes last_unexpected_;
  std::chrono::nanoseconds slowest_{0};  ///< timeout of the slowest station that was asked
  SteadyTime last_heard_{};
  bool never_silent_ = false;
  bool answered_ = false;  ///< in this session
  bool ever_answered_ = false;
  bool closed_unanswered_ = false;
  bool closed_after_silence_ = false;
  std::unique_ptr<WireTrace> trace_;  ///< null: the link is not traced
  Counters counters_;
};

}  // namespace fxagent
