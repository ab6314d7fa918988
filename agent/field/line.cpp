#include "agent/field/line.h"

#include <algorithm>
#include <utility>

#include "agent/fault_point.h"
#include "agent/field/stream_io.h"

namespace fxagent {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;
using Clock = std::chrono::steady_clock;

constexpr milliseconds kOpenTimeout{5000};
// What an earlier session left in a serial server arrives at once or not at all.
constexpr milliseconds kQuietAfterOpen{50};
// GX Works2 and the known firmwares take 200 ms without a character as the end of a frame.
constexpr milliseconds kQuietBeforeResync{100};
constexpr milliseconds kQuietWithoutResync{1000};
constexpr int kQuietCharacters = 20;
// A line that never falls quiet (another master, noise) is asked all the same.
constexpr milliseconds kLongestDrain{3000};
// No protocol here has longer frames; beyond it the line babbles.
constexpr std::size_t kMaxReceived = 4096;
constexpr std::size_t kReadChunk = 512;
// How often a probing read that is refused is asked: the first NAK may be an order's late one.
constexpr int kProbes = 3;

bool answers_by_ack(const Request& request) { return !std::holds_alternative<Read>(request); }

/// Bytes for an error text: enough of them to see who spoke.
std::string beginning_of(const Bytes& bytes) {
  constexpr std::size_t kShown = 24;
  const ByteView shown = ByteView(bytes).first(std::min(bytes.size(), kShown));
  return to_hex(shown) + (shown.size() < bytes.size() ? " …" : "");
}

}  // namespace

Line::Line(asio::any_io_executor executor, std::unique_ptr<Transport> transport,
           nanoseconds char_time)
    : transport_(std::move(transport)), timer_(executor), char_time_(char_time) {}

asio::awaitable<Result<void>> Line::open() {
  auto opened = co_await transport_->open(Clock::now() + kOpenTimeout);
  if (!opened) co_return opened;
  ++session_;  // a doubt stays: a serial server hands a late answer to whoever is connected now
  std::uint8_t waste[kReadChunk];
  const auto give_up = Clock::now() + kLongestDrain;
  while (Clock::now() < give_up) {
    const auto got = co_await transport_->read_some(waste, Clock::now() + kQuietAfterOpen);
    if (got) continue;
    if (got.error().code != ErrorCode::timeout) {
      transport_->close();
      co_return tl::unexpected<Error>(got.error());
    }
    break;
  }
  co_return Result<void>{};
}

asio::awaitable<Exchange> Line::exchange(Station& station, Request request, SteadyTime not_after) {
  Exchange failed;
  const bool ready = co_await prepare(station, failed);
  if (!ready) co_return failed;
  co_return co_await send_and_receive(*station.codec, station, std::move(request), not_after);
}

asio::awaitable<bool> Line::prepare(Station& station, Exchange& failed) {
  const bool in_doubt = doubt_ != Doubt::none;
  const bool may_enquire = station.enquire != EnquirePolicy::never;
  const auto resync = station.codec->resync();
  const auto refuse = [&failed](Exchange exchange) {
    failed = std::move(exchange);
    failed.sent = false;  // the enquiry is no part of the caller's question
    return false;
  };
  if (in_doubt) {
    station.greeted_in = 0;
    co_await drain(station);
    if (!transport_->is_open()) {
      failed.outcome = Exchange::Outcome::link_down;
      failed.error = "the line was lost";
      failed.ended = Clock::now();
      co_return false;
    }
  }
  const bool wanted = station.greeted_in != session_ || station.enquire == EnquirePolicy::always;
  if (resync && may_enquire && wanted) {
    Exchange enquiry =
        co_await send_and_receive(*station.codec, station, *resync, SteadyTime::max());
    const bool answered = enquiry.is_ack() || !station.codec->expects_reply(*resync);
    if (!answered) co_return refuse(std::move(enquiry));
    station.greeted_in = session_;
  }
  // The enquiry's ACK may have been the late one of a write. A read cannot be answered by an ACK,
  // and the device answers in order: once its data is here, nothing older is on the way.
  const auto probe = station.codec->probe();
  if (doubt_ == Doubt::stale_ack && probe) {
    Exchange probing;
    for (int i = 0; i < kProbes && !probing.is_data(); ++i) {
      probing = co_await send_and_receive(*station.codec, station, *probe, SteadyTime::max());
      if (!probing.has_answer()) co_return refuse(std::move(probing));
    }
  }
  doubt_ = Doubt::none;
  co_return true;
}

asio::awaitable<Exchange> Line::send_and_receive(const Codec& codec, const Station& station,
                                                 Request request, SteadyTime not_after) {
  Exchange exchange;
  const auto frame = codec.encode(request, ++tag_);
  if (!frame) {
    exchange.outcome = Exchange::Outcome::garbled;
    exchange.error = frame.error().text;
    co_return exchange;
  }
  co_await keep_gap(codec, station.gap);
  const auto stale = transport_->discard_input();
  exchange.began = exchange.ended = Clock::now();
  if (!stale) {
    exchange.outcome = Exchange::Outcome::link_down;
    exchange.error = stale.error().text;
    co_return exchange;
  }
  if (exchange.began > not_after) {
    exchange.outcome = Exchange::Outcome::expired;
    co_return exchange;
  }
  const LineLength length = codec.line_length(request);
  const auto line = char_time_ * (length.request_chars + length.reply_chars);
  // What closed the exchange before may still be leaving; this request goes right behind it.
  const auto on_the_wire = std::max(exchange.began, last_activity_);
  const auto deadline = on_the_wire + line + station.timeout;

  const auto written = co_await transport_->write(*frame, deadline);
  ++counters_.exchanges;
  exchange.sent = written.sent > 0;
  const auto trace = [&station](WireFrame::Way way, ByteView bytes) {
    if (station.trace != nullptr) station.trace->add(way, bytes);
  };
  if (station.trace != nullptr) fault_point("frame_sent");
  trace(WireFrame::Way::out, ByteView(*frame).first(std::min(written.sent, frame->size())));
  if (written.error) {
    transport_->close();
    exchange.outcome = Exchange::Outcome::link_down;
    exchange.error = written.error->text;
    exchange.ended = Clock::now();
    note_doubt(codec, request, exchange);
    co_return exchange;
  }
  if (codec.expects_reply(request)) {
    // The codecs pass over the echo of a read by themselves, so a read tells whether it still
    // comes.
    const bool reads = std::holds_alternative<Read>(request);
    const bool echo = station.echo || (echo_found() && !reads);
    co_await receive(codec, request, *frame, echo, deadline, exchange);
    trace(WireFrame::Way::in, rx_);
  } else {
    // Nobody answers: it is over when the last byte has left the wire, not when the kernel has it.
    timer_.expires_at(exchange.began + char_time_ * length.request_chars);
    co_await timer_.async_wait(use_result);
    exchange.outcome = Exchange::Outcome::answered;
    exchange.reply.kind = Reply::Kind::ack;
    not_before_ = Clock::now() + codec.pause_after(request);
  }
  exchange.ended = last_activity_ = Clock::now();
  if (!exchange.reply.closing.empty()) {
    trace(WireFrame::Way::out, exchange.reply.closing);
    last_activity_ += char_time_ * static_cast<int>(exchange.reply.closing.size());
    co_await close_exchange(exchange.reply.closing, station.echo || echo_found(),
                            last_activity_ + station.timeout);
  }
  exchange.ended_ms = utc_ms(std::chrono::system_clock::now());
  counters_.busy += last_activity_ - exchange.began;
  note_doubt(codec, request, exchange);
  if (exchange.has_answer()) {
    exchange.turnaround = std::max(nanoseconds(0), exchange.ended - on_the_wire - line);
    counters_.turnaround_ms.add(exchange.turnaround);
  }
  co_return exchange;
}

asio::awaitable<void> Line::close_exchange(const Bytes& closing, bool echo, SteadyTime deadline) {
  const auto written = co_await transport_->write(closing, deadline);
  if (written.error || !echo) co_return;
  std::uint8_t waste[kReadChunk];
  for (std::size_t back = 0; back < closing.size();) {
    const auto got = co_await transport_->read_some(waste, deadline);
    if (!got) co_return;
    back += *got;
  }
}

asio::awaitable<void> Line::receive(const Codec& codec, const Request& request, const Bytes& sent,
                                    bool echo, SteadyTime deadline, Exchange& exchange) {
  rx_.clear();
  bool echo_due = echo;
  std::uint8_t chunk[kReadChunk];
  for (;;) {
    const auto got = co_await transport_->read_some(chunk, deadline);
    if (!got) {
      const bool silent = got.error().code == ErrorCode::timeout;
      exchange.error = got.error().text;
      if (silent && !rx_.empty()) exchange.error += "; what came is none: " + beginning_of(rx_);
      if (echo_due && silent) exchange.error += "; not even the echo of the request came back";
      exchange.outcome = silent ? Exchange::Outcome::unanswered : Exchange::Outcome::link_down;
      if (!silent) transport_->close();
      co_return;
    }
    rx_.insert(rx_.end(), chunk, chunk + *got);
    if (echo_due) {
      const auto own = std::search(rx_.begin(), rx_.end(), sent.begin(), sent.end());
      if (own == rx_.end() && rx_.size() <= kMaxReceived) continue;
      if (own != rx_.end()) rx_.erase(rx_.begin(), own + static_cast<std::ptrdiff_t>(sent.size()));
      echo_due = false;
      if (rx_.empty()) continue;
    }
    auto decoded = codec.decode(request, tag_, rx_);
    if (!decoded || rx_.size() > kMaxReceived) {
      exchange.outcome = Exchange::Outcome::garbled;
      exchange.error = decoded ? "no end of frame on a babbling line" : decoded.error().text;
      co_return;
    }
    if (*decoded) {
      // No answer to a read begins with the question, so what does is an echo.
      if (std::holds_alternative<Read>(request) && !echo) {
        const bool echoed =
            rx_.size() > sent.size() && std::equal(sent.begin(), sent.end(), rx_.begin());
        echoes_in_a_row_ = echoed ? std::min(echoes_in_a_row_ + 1, kEchoesFound) : 0;
      }
      exchange.outcome = Exchange::Outcome::answered;
      exchange.reply = std::move(**decoded);
      co_return;
    }
  }
}

void Line::note_doubt(const Codec& codec, const Request& request, const Exchange& exchange) {
  Recovery recovery = Recovery::none;
  switch (exchange.outcome) {
    case Exchange::Outcome::answered:
      if (exchange.is_nak()) ++counters_.naks;
      return;
    case Exchange::Outcome::unanswered:
      ++counters_.timeouts;
      recovery = codec.after_silence();
      break;
    case Exchange::Outcome::garbled:
      ++counters_.bad_frames;
      recovery = codec.after_nonsense();
      break;
    case Exchange::Outcome::link_down:
      if (exchange.sent) recovery = codec.after_silence();
      break;
    case Exchange::Outcome::expired:
      return;
  }
  if (recovery == Recovery::none) return;
  if (recovery == Recovery::reconnect) return transport_->close();
  // A lost ACK stays a worry until a read has been answered, whatever is asked in between.
  if (answers_by_ack(request) || doubt_ == Doubt::stale_ack)
    doubt_ = Doubt::stale_ack;
  else
    doubt_ = Doubt::stale_data;
}

asio::awaitable<void> Line::drain(const Station& station) {
  // Without an enquiry that is answered only silence tells that the late answer is not coming any
  // more: nobody answers the EOT of a computer link.
  const auto resync = station.codec->resync();
  const bool is_answered =
      resync && station.codec->expects_reply(*resync) && station.enquire != EnquirePolicy::never;
  nanoseconds quiet = is_answered
                          ? kQuietBeforeResync
                          : std::clamp(station.timeout, kQuietBeforeResync, kQuietWithoutResync);
  quiet = std::max(quiet, char_time_ * kQuietCharacters);
  const auto give_up = Clock::now() + kLongestDrain;
  std::uint8_t waste[kReadChunk];
  while (Clock::now() < give_up) {
    const auto got = co_await transport_->read_some(waste, Clock::now() + quiet);
    if (got) continue;
    if (got.error().code != ErrorCode::timeout) transport_->close();
    co_return;
  }
}

asio::awaitable<void> Line::keep_gap(const Codec& codec, milliseconds gap) {
  const nanoseconds quiet = std::max<nanoseconds>(gap, codec.quiet_before(char_time_));
  auto earliest = not_before_;
  if (quiet.count() > 0) earliest = std::max(earliest, last_activity_ + quiet);
  if (Clock::now() >= earliest) co_return;
  timer_.expires_at(earliest);
  co_await timer_.async_wait(use_result);
}

}  // namespace fxagent
