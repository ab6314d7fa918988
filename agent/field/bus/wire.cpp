#include "agent/field/bus/wire.h"

#include <algorithm>
#include <random>
#include <utility>

#include "agent/failpoint.h"
#include "agent/field/bus/unexpected_bytes.h"
#include "agent/field/transport/stream_io.h"

namespace fxagent {
namespace {

using std::chrono::nanoseconds;

// No protocol here has longer frames; a line that brings more is babbling.
constexpr std::size_t kMaxReceived = 4096;
constexpr std::size_t kWireChunk = 512;
// More datagrams than this in place of one answer are a flood.
constexpr std::size_t kMostDatagrams = 1000;

/// Sends the bytes that close an exchange. With `is_echoed`, waits for their echo.
asio::awaitable<void> close_exchange(Transport& transport, Echo& echo, const Bytes& closing,
                                     bool is_echoed, SteadyTime deadline) {
  const auto written = co_await transport.write(closing, deadline);
  echo.sent_unanswered(closing);
  if (written.error || !is_echoed) co_return;
  std::uint8_t waste[kWireChunk];
  for (std::size_t back = 0; back < closing.size();) {
    const auto got = co_await transport.read_some(waste, deadline);
    if (!got) co_return;
    back += *got;
  }
}

}  // namespace

Wire::Wire(asio::any_io_executor executor, std::unique_ptr<Transport> transport,
           nanoseconds char_time)
    : channel_(std::move(transport)),
      overheard_(channel_.transport().can_renew()),
      timer_(executor),
      char_time_(char_time) {}

asio::awaitable<Result<void>> Wire::open(nanoseconds listening) {
  // Answers to an earlier agent process may reach a fixed port. A random first tag keeps them
  // apart.
  const Transport& transport = channel_.transport();
  if (channel_.session() == 0 && transport.has_datagrams() && !transport.can_renew())
    tag_ = static_cast<std::uint16_t>(std::random_device()());
  const Channel::Received received = co_await channel_.open(listening);
  if (trace_ && !received.bytes.empty()) trace_->unasked(received.bytes, now());
  if (!received.error) co_return Result<void>{};
  if (channel_.never_silent() && !received.bytes.empty()) overheard_.keep(received.bytes);
  co_return tl::unexpected<Error>(*received.error);
}

void Wire::close() noexcept {
  timer_.cancel();
  channel_.close();
}

void Wire::begin(const Station& station) {
  if (trace_) trace_->speak_to(station);
}

Result<void> Wire::take_arrived(const Codec& codec) {
  const auto found = channel_.transport().discard_input();
  if (!found) {
    channel_.lose(found.error().text);
    return fail(found);
  }
  note_unexpected(codec, *found);
  if (found->size() < Channel::kMostDrained) return {};
  channel_.close_never_silent();
  return fail(ErrorCode::link_down, channel_.why_lost());
}

asio::awaitable<bool> Wire::drain(const Codec& codec, SteadyTime until, nanoseconds quiet) {
  const Channel::Received received = co_await channel_.listen(until, quiet);
  counters_.unexpected_bytes += received.total - received.bytes.size();
  note_unexpected(codec, received.bytes);
  co_return !received.error;
}

void Wire::note_unexpected(const Codec& codec, ByteView bytes) {
  if (bytes.empty()) return;
  if (trace_) trace_->unasked(bytes.first(std::min(bytes.size(), Overheard::kMostJudged)), now());
  counters_.unexpected_bytes += overheard_.judge(codec, bytes, now());
}

asio::awaitable<Exchange> Wire::exchange(const Station& station, Request request,
                                         SteadyTime not_after) {
  const Codec& codec = *station.codec;
  const auto frame = codec.encode(request, ++tag_);
  if (!frame) co_return Exchange::unsent(Exchange::Outcome::garbled, frame.error().text);
  Exchange exchange;
  exchange.rest = std::max<nanoseconds>(station.gap, codec.quiet_before(char_time_));
  const SteadyTime rests_from = now();
  SteadyTime earliest = not_before_;
  if (exchange.rest.count() > 0) earliest = std::max(earliest, last_activity_ + exchange.rest);
  if (now() < earliest) co_await wait_until(timer_, earliest);
  auto ready = take_arrived(codec);
  if (ready && !is_numbered(codec)) ready = channel_.transport().renew();
  if (!ready) co_return Exchange::unsent(Exchange::Outcome::link_down, ready.error().text);
  exchange.began = exchange.ended = now();
  if (exchange.began > not_after) {
    exchange.outcome = Exchange::Outcome::expired;
    co_return exchange;
  }
  const LineLength length = codec.line_length(request);
  const auto line =
      char_time_ * (length.request_chars + length.reply_chars + length.more_reply_chars);
  // The closing bytes of the previous exchange may still be leaving; this request follows them.
  const auto on_the_wire = std::max(exchange.began, last_activity_);
  const auto deadline = on_the_wire + line + station.timeout;

  const auto written = co_await channel_.transport().write(*frame, deadline);
  overheard_.echo().sent(*frame);
  ++counters_.exchanges;
  exchange.sent = written.sent > 0;
  const auto trace = [&station](WireFrame::Way way, ByteView bytes) {
    if (station.trace != nullptr) station.trace->add(way, bytes);
  };
  if (station.trace != nullptr) failpoint("frame_sent");
  const ByteView left = ByteView(*frame).first(std::min(written.sent, frame->size()));
  trace(WireFrame::Way::out, left);
  if (trace_) trace_->out(left, exchange.began);
  if (written.error) {
    channel_.lose(written.error->text);
    exchange.outcome = Exchange::Outcome::link_down;
    exchange.error = written.error->text;
    exchange.ended = now();
    note_outcome(station, request, exchange);
    co_return exchange;
  }
  if (codec.expects_reply(request)) {
    // The codecs skip the echo of a read or an enquiry on their own. A read therefore shows whether
    // the line still echoes, and an enquiry before it does not fail for lack of an echo.
    const bool skips_echo = is_read(request) || std::holds_alternative<Enquire>(request);
    const bool echo = station.echo || (overheard_.echo().is_found() && !skips_echo);
    co_await receive(codec, request, *frame, echo, deadline, exchange);
    trace(WireFrame::Way::in, rx_);
    if (!exchange.has_answer() && !rx_.empty()) {
      exchange.received = rx_;
      exchange.asked = *frame;
    }
  } else {
    // No answer comes. The exchange ends when the last byte has left the wire, not when the kernel
    // has accepted it.
    const SteadyTime has_left = exchange.began + char_time_ * length.request_chars;
    if (now() < has_left) co_await wait_until(timer_, has_left);
    exchange.outcome = Exchange::Outcome::answered;
    exchange.reply.kind = Reply::Kind::ack;
    overheard_.echo().sent_unanswered(*frame);
    not_before_ = now() + codec.pause_after(request);
  }
  exchange.ended = last_activity_ = now();
  if (trace_ && codec.expects_reply(request))
    trace_->ended(exchange, rx_, exchange.ended, deadline);
  if (!exchange.reply.closing.empty()) {
    trace(WireFrame::Way::out, exchange.reply.closing);
    if (trace_) trace_->out(exchange.reply.closing, exchange.ended);
    last_activity_ += char_time_ * static_cast<int>(exchange.reply.closing.size());
    co_await close_exchange(channel_.transport(), overheard_.echo(), exchange.reply.closing,
                            station.echo || overheard_.echo().is_found(),
                            last_activity_ + station.timeout);
  }
  exchange.ended_ms = utc_now_ms();
  if (exchange.has_answer() && codec.expects_reply(request)) channel_.answered();
  counters_.busy += last_activity_ - rests_from;
  note_outcome(station, request, exchange);
  if (exchange.has_answer()) {
    exchange.turnaround = std::max(nanoseconds(0), exchange.ended - on_the_wire - line);
    counters_.turnaround_ms.add(exchange.turnaround);
    if (counters_.durations) counters_.durations->turnaround.add(exchange.turnaround);
  }
  co_return exchange;
}

asio::awaitable<void> Wire::receive(const Codec& codec, const Request& request, const Bytes& sent,
                                    bool echo, SteadyTime deadline, Exchange& exchange) {
  rx_.clear();
  bool echo_due = echo;
  const bool datagrams = channel_.transport().has_datagrams();
  bool goes_on = false;  // the current datagram has unread bytes
  std::size_t total = 0;
  std::size_t datagram_count = 0;
  std::uint8_t chunk[kWireChunk];
  for (;;) {
    const auto got = co_await channel_.transport().read_some(chunk, deadline);
    if (!got) {
      const bool silent = got.error().code == ErrorCode::timeout;
      exchange.error = got.error().text;
      if (silent && !rx_.empty())
        exchange.error += "; these bytes are not one: " + first_bytes(rx_);
      if (echo_due && silent) exchange.error += "; not even the echo of the request came back";
      exchange.outcome = silent ? Exchange::Outcome::unanswered : Exchange::Outcome::link_down;
      if (!silent) channel_.lose(exchange.error);
      co_return;
    }
    total += *got;
    datagram_count += goes_on ? 0 : 1;
    if (datagrams && (total > Channel::kMostDrained || datagram_count > kMostDatagrams)) {
      channel_.close_never_silent();
      exchange.outcome = Exchange::Outcome::link_down;
      exchange.error = channel_.why_lost();
      co_return;
    }
    // A datagram never continues the previous one, which was not an answer.
    if (datagrams && !goes_on) note_unexpected(codec, std::exchange(rx_, {}));
    rx_.insert(rx_.end(), chunk, chunk + *got);
    overheard_.received(now());
    goes_on = channel_.transport().has_rest();
    if (goes_on && rx_.size() <= kMaxReceived) continue;
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
      exchange.error = decoded ? "bytes without an end of frame" : decoded.error().text;
      co_return;
    }
    const bool alone = *decoded && (*decoded)->began == 0 && (*decoded)->consumed == rx_.size();
    if (datagrams && *decoded && !alone) {
      exchange.outcome = Exchange::Outcome::garbled;
      exchange.error = "a datagram with more than one answer";
      co_return;
    }
    if (*decoded) {
      exchange.outcome = Exchange::Outcome::answered;
      exchange.reply = std::move(**decoded);
      if (is_read(request) && !echo)
        overheard_.echo().learn(ByteView(rx_).first(exchange.reply.began), sent);
      note_around_answer(codec, sent, exchange.reply);
      co_return;
    }
  }
}

void Wire::note_around_answer(const Codec& codec, const Bytes& sent, const Reply& reply) {
  Bytes before(rx_.begin(), rx_.begin() + static_cast<std::ptrdiff_t>(reply.began));
  note_unexpected(codec, Echo::without_echo(std::move(before), sent));
  overheard_.echo().forget_unanswered();
  // Reading what has already arrived costs no time. A NAK behind an ACK is found before the next
  // request.
  Bytes behind(rx_.begin() + static_cast<std::ptrdiff_t>(reply.consumed), rx_.end());
  const auto more = overheard_.tells_answers_apart(codec) ? Result<Bytes>(Bytes{})
                                                          : channel_.transport().discard_input();
  if (more) behind.insert(behind.end(), more->begin(), more->end());
  note_unexpected(codec, behind);
}

void Wire::note_error(const Station& station, const Exchange& exchange) {
  counters_.last_error = station.device;
  counters_.last_error += ": " + (exchange.is_nak() ? exchange.reply.text : exchange.error);
  counters_.last_error_ms = exchange.ended_ms;
}

void Wire::note_outcome(const Station& station, const Request& request, const Exchange& exchange) {
  const Codec& codec = *station.codec;
  Recovery recovery = Recovery::none;
  switch (exchange.outcome) {
    case Exchange::Outcome::answered:
      if (!exchange.is_nak()) return;
      ++counters_.naks;
      return note_error(station, exchange);
    case Exchange::Outcome::unanswered:
      ++counters_.timeouts;
      note_error(station, exchange);
      recovery = codec.after_silence();
      break;
    case Exchange::Outcome::garbled:
      ++counters_.bad_frames;
      note_error(station, exchange);
      recovery = codec.after_nonsense();
      break;
    case Exchange::Outcome::link_down:
      // No late answer reaches a port of its own that is closed.
      if (exchange.sent && !channel_.transport().can_renew()) recovery = codec.after_silence();
      break;
    case Exchange::Outcome::expired:
      return;
  }
  const bool datagrams = channel_.transport().has_datagrams();
  // The rest of the answer would precede the next one, and nothing marks the start of that.
  const bool broken_off = exchange.outcome == Exchange::Outcome::unanswered && !rx_.empty();
  if (recovery == Recovery::none && broken_off && !datagrams) recovery = Recovery::reconnect;
  if (recovery == Recovery::none) return;
  if (recovery == Recovery::reconnect && !datagrams) {
    // The next attempt after a loss waits, and all devices are offline until then. One device may
    // send nonsense while others answer. A peer that has never answered may be a stranger.
    const bool is_stranger =
        exchange.outcome == Exchange::Outcome::garbled && !channel_.was_ever_answered();
    const bool is_loss = exchange.outcome == Exchange::Outcome::link_down || is_stranger;
    return is_loss ? channel_.close() : channel_.close_after_silence();
  }
  if (datagrams && is_numbered(codec)) return;
  // A lost ACK stays owed until a read has been answered, whatever is asked in between.
  const LineLength length = codec.line_length(request);
  overheard_.late().given_up(
      is_read(request) ? LateAnswers::Owed::data : LateAnswers::Owed::acknowledgement,
      exchange.ended, station.timeout, length.reply_chars + length.more_reply_chars);
}

}  // namespace fxagent
