#include "agent/field/bus/bus.h"

#include <algorithm>
#include <random>
#include <utility>

#include "agent/failpoint.h"
#include "agent/field/transport/stream_io.h"

namespace fxagent {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;

constexpr milliseconds kOpenTimeout{5000};
// A serial server delivers what it has buffered at once or not at all.
constexpr milliseconds kQuietAfterOpen{50};
// GX Works2 and the known firmwares treat 200 ms without a character as the end of a frame.
constexpr milliseconds kQuietBeforeResync{100};
constexpr int kQuietCharacters = 20;
// The channel is closed if the line is not quiet after this time, or brings this many bytes.
constexpr milliseconds kLongestDrain{3000};
constexpr std::size_t kMostDrained = Transport::kMostDiscarded;
constexpr milliseconds kLongestQuiet{5000};
// Unexpected bytes that are examined: more than the longest frame of a serial line.
constexpr std::size_t kMostJudged = 1024;
// Unexpected bytes that are kept for display until the agent ends.
constexpr std::size_t kMostKept = 64;
// No protocol here has longer frames; a line that brings more is babbling.
constexpr std::size_t kMaxReceived = 4096;
constexpr std::size_t kReadChunk = 512;
// More datagrams than this in place of one answer are a flood.
constexpr std::size_t kMostDatagrams = 1000;
constexpr std::string_view kNeverSilent =
    "bytes come without end (another master, noise, or wrong settings?)";
// Attempts for a probe that is refused: the first NAK may be a command's late one.
constexpr int kProbesInARow = 3;

bool answers_by_ack(const Request& request) { return !is_read(request); }

/// True if answers carry numbers. A late or repeated answer then never matches another request.
bool is_numbered(const Codec& codec) { return codec.after_silence() == Recovery::none; }

/// Returns the first bytes for an error text: enough to recognise the sender.
std::string beginning_of(const Bytes& bytes) {
  constexpr std::size_t kBeginning = 24;
  const ByteView shown = ByteView(bytes).first(std::min(bytes.size(), kBeginning));
  return to_hex(shown) + (shown.size() < bytes.size() ? " …" : "");
}

}  // namespace

Bus::Bus(asio::any_io_executor executor, std::unique_ptr<Transport> transport,
         nanoseconds char_time, nanoseconds listening)
    : transport_(std::move(transport)),
      timer_(executor),
      char_time_(char_time),
      listening_(listening) {}

asio::awaitable<Result<void>> Bus::open() {
  answered_ = closed_unanswered_ = closed_after_silence_ = false;
  auto opened = co_await transport_->open(now() + kOpenTimeout);
  if (!opened) co_return opened;
  // Answers to an earlier agent process may reach a fixed port. A random first tag keeps them
  // apart.
  if (session_ == 0 && transport_->has_datagrams() && !transport_->can_renew())
    tag_ = static_cast<std::uint16_t>(std::random_device()());
  ++session_;
  // Answers to another port do not reach this one.
  if (transport_->can_renew()) co_return Result<void>{};
  // A serial server delivers a late answer to the current connection. A PLC on a serial port
  // answers whichever program has it open. An earlier program may have sent its last request just
  // now.
  const Drained drained = co_await listen(now() + listening_, kQuietAfterOpen);
  if (trace_ && !drained.heard.empty()) trace_->unasked(drained.heard);
  if (drained.error && never_silent_) keep_unexpected(drained.heard);
  if (drained.error && !never_silent_) note_lost();
  if (drained.error) co_return tl::unexpected<Error>(*drained.error);
  co_return Result<void>{};
}

std::string_view Bus::why_lost() const {
  return never_silent_ ? kNeverSilent : "the line was lost";
}

bool Bus::tells_answers_apart(const Codec& codec) const {
  return is_numbered(codec) || transport_->can_renew();
}

void Bus::close_never_silent() {
  transport_->close();
  never_silent_ = true;
}

asio::awaitable<Exchange> Bus::exchange(Station& station, Request request, SteadyTime not_after) {
  slowest_ = std::max<nanoseconds>(slowest_, station.timeout);
  const Codec& codec = *station.codec;
  if (trace_) trace_->speak_to(station.device, station.codec);
  Exchange failed;
  const bool open = tells_answers_apart(codec) || look(codec, failed);
  if (!open) co_return failed;
  const bool ready = co_await prepare(station, request, failed);
  if (!ready) {
    bus_doubt_.exchange_was_unclear();
    co_return failed;
  }
  Exchange exchange = co_await ask(station, request, not_after);
  if (is_out_of_step(codec, exchange)) bus_doubt_.was_out_of_step(now());
  const bool again = exchange.is_data() && !exchange.doubted && is_read(request) &&
                     !tells_answers_apart(codec) && bus_doubt_.is_wary(now());
  if (!again) co_return exchange;
  Exchange second = co_await ask(station, request, SteadyTime::max());
  second.sent = true;
  second.rest = exchange.rest;
  second.began = exchange.began;
  co_return second;
}

asio::awaitable<Exchange> Bus::ask(Station& station, const Request& request, SteadyTime not_after) {
  const Codec& codec = *station.codec;
  const std::uint64_t findings = bus_doubt_.findings();
  const bool doubted = bus_doubt_.is_doubted();
  Exchange exchange = co_await send_and_receive(codec, station, request, not_after);
  co_await judge(codec, findings, doubted, exchange);
  co_return exchange;
}

bool Bus::look(const Codec& codec, Exchange& failed) {
  const auto found = transport_->discard_input();
  std::string why = found ? "" : found.error().text;
  if (!found) note_lost();
  if (found) {
    note_unexpected(codec, *found);
    if (found->size() >= kMostDrained) {
      close_never_silent();
      why = kNeverSilent;
    }
  }
  if (why.empty()) return true;
  failed.outcome = Exchange::Outcome::link_down;
  failed.error = std::move(why);
  failed.began = failed.ended = now();
  return false;
}

bool Bus::renew_port(const Codec& codec, Exchange& failed) {
  if (is_numbered(codec)) return true;
  const auto renewed = transport_->renew();
  if (renewed) return true;
  failed.outcome = Exchange::Outcome::link_down;
  failed.error = renewed.error().text;
  failed.began = failed.ended = now();
  return false;
}

void Bus::give_up_datagram(const Codec& codec) {
  note_unexpected(codec, rx_);
  rx_.clear();
}

void Bus::note_unexpected(const Codec& codec, ByteView bytes) {
  if (bytes.empty()) return;
  if (trace_) trace_->unasked(bytes.first(std::min(bytes.size(), kMostJudged)));
  last_heard_ = now();
  if (may_be_returned(bytes)) return;
  counters_.unexpected_bytes += bytes.size();
  const ByteView shown = bytes.first(std::min(bytes.size(), kMostJudged));
  keep_unexpected(shown);
  // Foreign bytes do no harm if answers carry numbers or arrive on ports of their own.
  if (tells_answers_apart(codec)) return;
  const bool may_pass = codec.may_pass_for_answer(shown);
  if (late_.owed() == LateAnswers::Owed::none) {
    if (may_pass) bus_doubt_.found_foreign(last_heard_);
    return;
  }
  // prepare() handles the answer that is owed. More than that one is a second answer, or another's.
  if (late_.came(bytes.size()) && may_pass) bus_doubt_.was_out_of_step(last_heard_);
}

bool Bus::is_out_of_step(const Codec& codec, const Exchange& exchange) const {
  return !exchange.has_answer() && !exchange.heard.empty() && !tells_answers_apart(codec) &&
         !may_be_returned(exchange.heard) && codec.explain(exchange.heard, Direction::reply).ok;
}

bool Bus::may_be_returned(ByteView bytes) const {
  if (returns_nothing_) return false;
  // The line echoes. Either this is not detected yet, or the echoed bytes get no answer.
  return std::ranges::equal(bytes, last_sent_) || !std::ranges::search(unanswered_, bytes).empty();
}

void Bus::keep_unexpected(ByteView bytes) {
  const ByteView kept = bytes.first(std::min(bytes.size(), kMostKept));
  last_unexpected_.assign(kept.begin(), kept.end());
}

asio::awaitable<void> Bus::judge(const Codec& codec, std::uint64_t findings, bool doubted,
                                 Exchange& exchange) {
  if (!exchange.has_answer()) {
    if (exchange.sent) bus_doubt_.exchange_was_unclear();
    co_return;
  }
  if (codec.is_broadcast() || tells_answers_apart(codec)) {
    never_silent_ = false;
    co_return;
  }
  bool quiet_behind = true;
  if (doubted && bus_doubt_.findings() == findings)
    quiet_behind = co_await drain(codec, now(), quiet_in_doubt());
  const auto make_garbled = [&](std::string why) {
    exchange.outcome = Exchange::Outcome::garbled;
    exchange.error = std::move(why);
    ++counters_.bad_frames;
  };
  if (bus_doubt_.findings() != findings || !quiet_behind) {
    bus_doubt_.exchange_was_unclear();
    make_garbled("more than one answer came, or another's: " + beginning_of(last_unexpected_));
  } else if (doubted) {
    bus_doubt_.exchange_was_clean(now());
    exchange.doubted = true;
    if (!exchange.is_data())
      make_garbled("the answer is not believed: foreign bytes were on the line (" +
                   beginning_of(last_unexpected_) + ")");
  }
  if (!bus_doubt_.is_doubted()) never_silent_ = false;
}

asio::awaitable<bool> Bus::prepare(Station& station, const Request& request, Exchange& failed) {
  const Codec& codec = *station.codec;
  const bool bus_doubted = bus_doubt_.is_doubted() && !tells_answers_apart(codec);
  const bool in_doubt = late_.owed() != LateAnswers::Owed::none || bus_doubted;
  const bool may_enquire = station.enquire != EnquirePolicy::never;
  const auto resync = codec.resync();
  const auto refuse = [&failed](Exchange exchange) {
    failed = std::move(exchange);
    failed.sent = false;  // the enquiry is not part of the caller's request
    return false;
  };
  if (in_doubt) {
    station.handshake_in = 0;
    const nanoseconds quiet =
        bus_doubted ? quiet_in_doubt()
                    : std::max<nanoseconds>(kQuietBeforeResync, char_time_ * kQuietCharacters);
    // Silence that followed the last answer counts and is not repeated.
    const bool heard_out = late_.owed() == LateAnswers::Owed::none && now() - last_heard_ >= quiet;
    bool still_open = true;
    if (!heard_out) still_open = co_await drain(codec, late_answers_until(station), quiet);
    if (!still_open) {
      failed.outcome = Exchange::Outcome::link_down;
      failed.error = why_lost();
      failed.ended = now();
      co_return false;
    }
  }
  const bool wanted = station.handshake_in != session_ || station.enquire == EnquirePolicy::always;
  if (resync && may_enquire && wanted) {
    Exchange enquiry =
        co_await send_and_receive(*station.codec, station, *resync, SteadyTime::max());
    const bool answered = enquiry.is_ack() || !station.codec->expects_reply(*resync);
    if (!answered) co_return refuse(std::move(enquiry));
    station.handshake_in = session_;
  }
  // The enquiry's ACK may have been a write's late ACK.
  if (late_.owed() == LateAnswers::Owed::acknowledgement || bus_doubted) {
    Exchange probing = co_await probe(station, request);
    if (!probing.has_answer()) co_return refuse(std::move(probing));
  }
  late_.settled();
  co_return true;
}

asio::awaitable<Exchange> Bus::probe(const Station& station, const Request& request) {
  const Codec& codec = *station.codec;
  // A read is never answered by an ACK, and the device answers in order: once the data of the probe
  // is here, nothing older is on its way. The answer to a failed probe may still come, so the next
  // probe has an answer of another length.
  Exchange probing;
  for (int i = 0; i < kProbesInARow && !probing.is_data(); ++i) {
    auto question = codec.probe(late_.probe());
    if (!question && bus_doubt_.is_doubted()) question = codec.apart_from(request);
    if (!question) {
      probing.outcome = Exchange::Outcome::answered;  // no read with an answer of another length
      co_return probing;
    }
    probing = co_await send_and_receive(codec, station, std::move(*question), SteadyTime::max());
    if (!probing.is_data()) late_.probe_failed();
    if (!probing.has_answer()) co_return probing;
  }
  co_return probing;
}

asio::awaitable<Exchange> Bus::send_and_receive(const Codec& codec, const Station& station,
                                                Request request, SteadyTime not_after) {
  Exchange exchange;
  const auto frame = codec.encode(request, ++tag_);
  if (!frame) {
    exchange.outcome = Exchange::Outcome::garbled;
    exchange.error = frame.error().text;
    co_return exchange;
  }
  exchange.rest = std::max<nanoseconds>(station.gap, codec.quiet_before(char_time_));
  const SteadyTime rests_from = now();
  co_await keep_gap(exchange.rest);
  const bool open = look(codec, exchange) && renew_port(codec, exchange);
  if (!open) co_return exchange;
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

  const auto written = co_await transport_->write(*frame, deadline);
  last_sent_ = *frame;
  ++counters_.exchanges;
  exchange.sent = written.sent > 0;
  const auto trace = [&station](WireFrame::Way way, ByteView bytes) {
    if (station.trace != nullptr) station.trace->add(way, bytes);
  };
  if (station.trace != nullptr) failpoint("frame_sent");
  const ByteView left = ByteView(*frame).first(std::min(written.sent, frame->size()));
  trace(WireFrame::Way::out, left);
  if (trace_) trace_->out(left);
  if (written.error) {
    transport_->close();
    note_lost();
    exchange.outcome = Exchange::Outcome::link_down;
    exchange.error = written.error->text;
    exchange.ended = now();
    note_doubt(station, request, exchange);
    co_return exchange;
  }
  if (codec.expects_reply(request)) {
    // The codecs skip the echo of a read or an enquiry on their own. A read therefore shows whether
    // the line still echoes, and an enquiry before it does not fail for lack of an echo.
    const bool tells_them_apart = is_read(request) || std::holds_alternative<Enquire>(request);
    const bool echo = station.echo || (echo_found() && !tells_them_apart);
    co_await receive(codec, request, *frame, echo, deadline, exchange);
    trace(WireFrame::Way::in, rx_);
    note_heard(*frame, deadline, exchange);
  } else {
    // No answer comes. The exchange ends when the last byte has left the wire, not when the kernel
    // has accepted it.
    co_await wait_until(exchange.began + char_time_ * length.request_chars);
    exchange.outcome = Exchange::Outcome::answered;
    exchange.reply.kind = Reply::Kind::ack;
    unanswered_ = *frame;
    not_before_ = now() + codec.pause_after(request);
  }
  exchange.ended = last_activity_ = now();
  if (!exchange.reply.closing.empty()) {
    trace(WireFrame::Way::out, exchange.reply.closing);
    if (trace_) trace_->out(exchange.reply.closing);
    last_activity_ += char_time_ * static_cast<int>(exchange.reply.closing.size());
    co_await close_exchange(exchange.reply.closing, station.echo || echo_found(),
                            last_activity_ + station.timeout);
  }
  exchange.ended_ms = utc_ms(std::chrono::system_clock::now());
  if (exchange.has_answer() && codec.expects_reply(request)) answered_ = ever_answered_ = true;
  counters_.busy += last_activity_ - rests_from;
  note_doubt(station, request, exchange);
  if (exchange.has_answer()) {
    exchange.turnaround = std::max(nanoseconds(0), exchange.ended - on_the_wire - line);
    counters_.turnaround_ms.add(exchange.turnaround);
    if (counters_.durations) counters_.durations->turnaround.add(exchange.turnaround);
  }
  co_return exchange;
}

void Bus::note_heard(const Bytes& frame, SteadyTime deadline, Exchange& exchange) const {
  const bool answered = exchange.has_answer();
  if (!answered && !rx_.empty()) {
    exchange.heard = rx_;
    exchange.asked = frame;
  }
  if (!trace_) return;
  if (answered) {
    const std::size_t size = exchange.reply.consumed - exchange.reply.began;
    trace_->answer(ByteView(rx_).subspan(exchange.reply.began, size), now() - exchange.began);
  } else if (exchange.outcome == Exchange::Outcome::unanswered) {
    trace_->no_answer(rx_, deadline - exchange.began, {});
  } else {
    trace_->no_answer(rx_, now() - exchange.began, exchange.error);
  }
}

asio::awaitable<void> Bus::close_exchange(const Bytes& closing, bool echo, SteadyTime deadline) {
  const auto written = co_await transport_->write(closing, deadline);
  last_sent_ = unanswered_ = closing;
  if (written.error || !echo) co_return;
  std::uint8_t waste[kReadChunk];
  for (std::size_t back = 0; back < closing.size();) {
    const auto got = co_await transport_->read_some(waste, deadline);
    if (!got) co_return;
    back += *got;
  }
}

asio::awaitable<void> Bus::receive(const Codec& codec, const Request& request, const Bytes& sent,
                                   bool echo, SteadyTime deadline, Exchange& exchange) {
  rx_.clear();
  bool echo_due = echo;
  const bool datagrams = transport_->has_datagrams();
  bool goes_on = false;  // the current datagram has unread bytes
  std::size_t total = 0;
  std::size_t heard = 0;  // datagrams received
  std::uint8_t chunk[kReadChunk];
  for (;;) {
    const auto got = co_await transport_->read_some(chunk, deadline);
    if (!got) {
      const bool silent = got.error().code == ErrorCode::timeout;
      exchange.error = got.error().text;
      if (silent && !rx_.empty()) exchange.error += "; what came is none: " + beginning_of(rx_);
      if (echo_due && silent) exchange.error += "; not even the echo of the request came back";
      exchange.outcome = silent ? Exchange::Outcome::unanswered : Exchange::Outcome::link_down;
      if (silent) co_return;
      transport_->close();
      note_lost();
      co_return;
    }
    total += *got;
    heard += goes_on ? 0 : 1;
    if (datagrams && (total > kMostDrained || heard > kMostDatagrams)) {
      close_never_silent();
      exchange.outcome = Exchange::Outcome::link_down;
      exchange.error = kNeverSilent;
      co_return;
    }
    // A datagram never continues the previous one.
    if (datagrams && !goes_on) give_up_datagram(codec);
    rx_.insert(rx_.end(), chunk, chunk + *got);
    last_heard_ = now();
    goes_on = transport_->has_rest();
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
      exchange.error = decoded ? "no end of frame on a babbling line" : decoded.error().text;
      co_return;
    }
    const bool alone = *decoded && (*decoded)->began == 0 && (*decoded)->consumed == rx_.size();
    if (datagrams && *decoded && !alone) {
      exchange.outcome = Exchange::Outcome::garbled;
      exchange.error = "a datagram with more in it than one answer";
      co_return;
    }
    if (*decoded) {
      exchange.outcome = Exchange::Outcome::answered;
      exchange.reply = std::move(**decoded);
      note_around_answer(codec, sent, exchange.reply, is_read(request) && !echo);
      co_return;
    }
  }
}

void Bus::note_around_answer(const Codec& codec, const Bytes& sent, const Reply& reply,
                             bool tells_echo) {
  Bytes before(rx_.begin(), rx_.begin() + static_cast<std::ptrdiff_t>(reply.began));
  const auto own = std::search(before.begin(), before.end(), sent.begin(), sent.end());
  const bool echoed = own != before.end();
  if (tells_echo) {
    echoes_in_a_row_ = echoed ? std::min(echoes_in_a_row_ + 1, kEchoesFound) : 0;
    returns_nothing_ = before.empty();
  }
  if (echoed) before.erase(own, own + static_cast<std::ptrdiff_t>(sent.size()));
  note_unexpected(codec, before);
  unanswered_.clear();
  // Reading what has already arrived costs no time. A NAK behind an ACK is found before the next
  // request.
  Bytes behind(rx_.begin() + static_cast<std::ptrdiff_t>(reply.consumed), rx_.end());
  const auto more =
      tells_answers_apart(codec) ? Result<Bytes>(Bytes{}) : transport_->discard_input();
  if (more) behind.insert(behind.end(), more->begin(), more->end());
  note_unexpected(codec, behind);
}

void Bus::note_doubt(const Station& station, const Request& request, const Exchange& exchange) {
  const Codec& codec = *station.codec;
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
  const bool datagrams = transport_->has_datagrams();
  // The rest of the answer would precede the next one, and nothing marks the start of that.
  const bool broken_off = exchange.outcome == Exchange::Outcome::unanswered && !rx_.empty();
  if (recovery == Recovery::none && broken_off && !datagrams) recovery = Recovery::reconnect;
  if (recovery == Recovery::none) return;
  if (recovery == Recovery::reconnect && !datagrams) {
    closed_after_silence_ = exchange.outcome == Exchange::Outcome::unanswered;
    return transport_->close();
  }
  if (datagrams && is_numbered(codec)) return;
  // A lost ACK stays owed until a read has been answered, whatever is asked in between.
  const LineLength length = codec.line_length(request);
  late_.given_up(
      answers_by_ack(request) ? LateAnswers::Owed::acknowledgement : LateAnswers::Owed::data,
      exchange.ended, station.timeout, length.reply_chars + length.more_reply_chars);
}

SteadyTime Bus::late_answers_until(const Station& station) const {
  // After an enquiry's ACK nothing older can come. The EOT of a computer link is never answered.
  const auto resync = station.codec->resync();
  const bool is_answered =
      resync && station.codec->expects_reply(*resync) && station.enquire != EnquirePolicy::never;
  return is_answered || late_.owed() == LateAnswers::Owed::none ? now() : late_.over_at();
}

nanoseconds Bus::quiet_in_doubt() const {
  return std::clamp<nanoseconds>(std::max(slowest_, char_time_ * kQuietCharacters),
                                 kQuietBeforeResync, kLongestQuiet);
}

asio::awaitable<bool> Bus::drain(const Codec& codec, SteadyTime until, nanoseconds quiet) {
  const Drained drained = co_await listen(until, quiet);
  counters_.unexpected_bytes += drained.total - drained.heard.size();
  note_unexpected(codec, drained.heard);
  co_return !drained.error;
}

asio::awaitable<Bus::Drained> Bus::listen(SteadyTime until, nanoseconds quiet) {
  const auto give_up = std::max(until, now() + quiet) + kLongestDrain;
  std::uint8_t chunk[kReadChunk];
  Drained drained;
  for (;;) {
    const auto got = co_await transport_->read_some(chunk, std::max(until, now() + quiet));
    if (!got && got.error().code == ErrorCode::timeout) co_return drained;
    if (!got) {
      transport_->close();
      note_lost();
      drained.error = got.error();
      co_return drained;
    }
    drained.total += *got;
    if (drained.heard.size() < kMostJudged)
      drained.heard.insert(drained.heard.end(), chunk, chunk + *got);
    if (drained.total < kMostDrained && now() < give_up) continue;
    close_never_silent();
    drained.error = Error{ErrorCode::link_down, std::string(kNeverSilent)};
    co_return drained;
  }
}

asio::awaitable<void> Bus::keep_gap(nanoseconds quiet) {
  auto earliest = not_before_;
  if (quiet.count() > 0) earliest = std::max(earliest, last_activity_ + quiet);
  co_await wait_until(earliest);
}

asio::awaitable<void> Bus::wait_until(SteadyTime at) {
  if (now() >= at) co_return;
  timer_.expires_at(at);
  co_await timer_.async_wait(use_result);
}

}  // namespace fxagent
