#include "agent/field/bus/bus.h"

#include <algorithm>
#include <utility>

namespace fxagent {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;

// GX Works2 and the known firmwares treat 200 ms without a character as the end of a frame.
constexpr milliseconds kQuietBeforeResync{100};
constexpr int kQuietCharacters = 20;
constexpr milliseconds kLongestQuiet{5000};
// Attempts for a probe that is refused: the first NAK may be a command's late one.
constexpr int kProbesInARow = 3;

/// True if the station is enquired and answers: after its ACK no older data or NAK can come. The
/// EOT of a computer link is never answered.
bool enquiry_settles(const Station& station) {
  const auto resync = station.codec->resync();
  return resync && station.codec->expects_reply(*resync) && station.enquire != EnquirePolicy::never;
}

}  // namespace

asio::awaitable<Exchange> Bus::exchange(Station& station, Request request, SteadyTime not_after) {
  slowest_ = std::max<nanoseconds>(slowest_, station.timeout);
  const Codec& codec = *station.codec;
  wire_.begin(station);
  if (!overheard_.tells_answers_apart(codec))
    if (const auto open = wire_.take_arrived(codec); !open)
      co_return Exchange::unsent(Exchange::Outcome::link_down, open.error().text);
  Prepared prepared = co_await prepare(station, request);
  if (prepared.failure) {
    if (!overheard_.is_silence(*prepared.failure)) overheard_.doubt().exchange_was_unclear();
    prepared.failure->sent = false;  // enquiry and probe are not part of the caller's request
    co_return std::move(*prepared.failure);
  }
  Exchange exchange = co_await ask(station, request, not_after);
  exchange.rest += prepared.rest;
  if (overheard_.is_out_of_step(codec, exchange)) overheard_.doubt().was_out_of_step(wire_.now());
  const bool again = exchange.is_data() && !exchange.doubted && is_read(request) &&
                     !overheard_.tells_answers_apart(codec) &&
                     overheard_.doubt().is_wary(wire_.now());
  if (!again) co_return exchange;
  Exchange second = co_await ask(station, request, SteadyTime::max());
  second.sent = true;
  second.rest = exchange.rest;
  second.began = exchange.began;
  second.ended = std::max(second.ended, exchange.ended);  // the link may be lost before it
  co_return second;
}

asio::awaitable<Exchange> Bus::ask(Station& station, const Request& request, SteadyTime not_after) {
  const Codec& codec = *station.codec;
  const std::uint64_t findings = overheard_.doubt().findings();
  const bool doubted = overheard_.doubt().is_doubted();
  Exchange exchange = co_await wire_.exchange(station, request, not_after);
  if (!exchange.has_answer()) {
    if (exchange.sent && !overheard_.is_silence(exchange))
      overheard_.doubt().exchange_was_unclear();
    co_return exchange;
  }
  if (codec.is_broadcast() || overheard_.tells_answers_apart(codec)) {
    wire_.channel().answered_beyond_doubt();
    co_return exchange;
  }
  bool quiet_behind = true;
  if (doubted && overheard_.doubt().findings() == findings)
    quiet_behind = co_await wire_.drain(codec, wire_.now(), quiet_in_doubt());
  const auto make_garbled = [&](std::string why) {
    exchange.outcome = Exchange::Outcome::garbled;
    exchange.error = std::move(why);
    ++counters().bad_frames;
  };
  if (overheard_.doubt().findings() != findings || !quiet_behind) {
    overheard_.doubt().exchange_was_unclear();
    make_garbled("several answers, or one to another request: " + unexpected_text());
  } else if (doubted) {
    overheard_.doubt().exchange_was_clean(wire_.now());
    exchange.doubted = true;
    if (!exchange.is_data())
      make_garbled("the answer does not count: unexpected bytes were on the line (" +
                   unexpected_text() + ")");
  }
  if (!overheard_.doubt().is_doubted()) wire_.channel().answered_beyond_doubt();
  co_return exchange;
}

asio::awaitable<Bus::Prepared> Bus::prepare(Station& station, const Request& request) {
  const Codec& codec = *station.codec;
  const bool bus_doubted =
      overheard_.doubt().is_doubted() && !overheard_.tells_answers_apart(codec);
  const bool in_doubt = overheard_.late().owed() != LateAnswers::Owed::none || bus_doubted;
  const bool may_enquire = station.enquire != EnquirePolicy::never;
  const auto resync = codec.resync();
  Prepared out;
  if (in_doubt) {
    station.handshake_in = 0;
    const nanoseconds quiet =
        bus_doubted
            ? quiet_in_doubt()
            : std::max<nanoseconds>(kQuietBeforeResync, wire_.char_time() * kQuietCharacters);
    // Silence that followed the last answer counts and is not repeated.
    const bool is_owed = overheard_.late().owed() != LateAnswers::Owed::none;
    const bool is_quiet = !is_owed && wire_.now() - overheard_.last_received() >= quiet;
    // Only silence can rule out a late answer, unless the enquiry settles it.
    const SteadyTime until =
        is_owed && !enquiry_settles(station) ? overheard_.late().over_at() : wire_.now();
    bool still_open = true;
    if (!is_quiet) still_open = co_await wire_.drain(codec, until, quiet);
    if (!still_open) {
      out.failure = Exchange::unsent(Exchange::Outcome::link_down, wire_.channel().why_lost());
      co_return out;
    }
  }
  const bool wanted =
      station.handshake_in != wire_.channel().session() || station.enquire == EnquirePolicy::always;
  if (resync && may_enquire && wanted) {
    Exchange enquiry = co_await wire_.exchange(station, *resync, SteadyTime::max());
    const bool answered = enquiry.is_ack() || !station.codec->expects_reply(*resync);
    if (!answered) {
      out.failure = std::move(enquiry);
      co_return out;
    }
    station.handshake_in = wire_.channel().session();
    out.rest = enquiry.line_time();
  }
  // The enquiry's ACK may have been a write's late ACK. Without an enquiry, a read's late NAK could
  // pass for the answer to a write.
  const bool may_mislead =
      overheard_.late().owed() == LateAnswers::Owed::acknowledgement ||
      (overheard_.late().owed() == LateAnswers::Owed::data && !is_read(request) &&
       !enquiry_settles(station) && !overheard_.tells_answers_apart(codec));
  if (may_mislead || bus_doubted) {
    auto unanswered = co_await probe(station, request);
    if (unanswered) {
      out.failure = std::move(unanswered);
      co_return out;
    }
  }
  overheard_.late().settled();
  co_return out;
}

asio::awaitable<std::optional<Exchange>> Bus::probe(const Station& station,
                                                    const Request& request) {
  const Codec& codec = *station.codec;
  // A read is never answered by an ACK, and the device answers in order: once the data of the probe
  // is here, nothing older is on its way. The answer to a failed probe may still come, so the next
  // probe has an answer of another length.
  for (int i = 0; i < kProbesInARow; ++i) {
    auto question = codec.probe(overheard_.late().probe());
    if (!question && overheard_.doubt().is_doubted()) question = codec.shorter_read(request);
    if (!question) break;  // no read with an answer of another length
    Exchange probing = co_await wire_.exchange(station, std::move(*question), SteadyTime::max());
    if (probing.is_data()) break;
    overheard_.late().probe_failed();
    if (!probing.has_answer()) co_return probing;
  }
  co_return std::nullopt;
}

nanoseconds Bus::quiet_in_doubt() const {
  return std::clamp<nanoseconds>(std::max(slowest_, wire_.char_time() * kQuietCharacters),
                                 kQuietBeforeResync, kLongestQuiet);
}

}  // namespace fxagent
