#include "agent/field/command/command_exchanges.h"

#include <asio/post.hpp>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

#include "agent/commands/result.h"
#include "agent/failpoint.h"
#include "agent/field/bus/unexpected_bytes.h"
#include "agent/field/command/command_line_time.h"
#include "agent/field/transport/stream_io.h"
#include "agent/line_time.h"

namespace fxagent {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;
using Clock = std::chrono::steady_clock;

/// The mark of one command, made on another thread. That thread answers here and wakes the command,
/// unless it has stopped waiting.
class Marking final : public std::enable_shared_from_this<Marking> {
 public:
  /// The command waits for `timer`, which must live until stop_waiting().
  explicit Marking(asio::steady_timer& timer) : timer_(&timer) {}

  /// Any thread.
  void answer(bool may_be_sent) {
    const std::lock_guard lock(mutex_);
    if (timer_ == nullptr) return;
    may_be_sent_ = may_be_sent;
    asio::post(timer_->get_executor(), [self = shared_from_this()] {
      if (self->timer_ != nullptr) self->timer_->cancel();
    });
  }
  /// Returns the answer; false if there is none. Later answers are ignored.
  bool stop_waiting() {
    const std::lock_guard lock(mutex_);
    timer_ = nullptr;
    return may_be_sent_;
  }

 private:
  std::mutex mutex_;
  /// Null: the command has stopped waiting. Changed on the field thread only.
  asio::steady_timer* timer_;
  bool may_be_sent_ = false;
};

/// Stops waiting also if the command is destroyed.
struct StopWaiting {
  void operator()(Marking* marking) const { marking->stop_waiting(); }
};

}  // namespace

CommandExchanges::CommandExchanges(asio::any_io_executor executor, Bus& bus, Station& station,
                                   const DeviceConfig& device, std::span<const Holes::Limit> limits,
                                   const AdmittedCommand& admitted, BusSharing& sharing)
    : timer_(executor),
      bus_(bus),
      station_(station),
      device_(device),
      limits_(limits),
      admitted_(admitted),
      sharing_(sharing) {}

SteadyTime CommandExchanges::latest_start() const {
  if (writes_ > 0 || admitted_.interrupted) return SteadyTime::max();
  if (first_byte_) return admitted_.deadline;
  return admitted_.deadline - admitted_.line_time.value_or(nanoseconds(0));
}

nanoseconds CommandExchanges::used() const {
  return part_began_ ? last_byte_ - *part_began_ : nanoseconds(0);
}

asio::awaitable<bool> CommandExchanges::go_on(bool share) {
  if (share && !is_stopping()) {
    const nanoseconds used_so_far = used();
    part_began_.reset();
    co_await sharing_.give_way(used_so_far);
  }
  co_return !is_stopping();
}

Exchange CommandExchanges::cut_off() {
  cut_off_ = true;
  return Exchange::unsent(Exchange::Outcome::link_down, why_not_sent(sharing_.why_stopping()));
}

asio::awaitable<bool> CommandExchanges::mark_started() {
  if (is_started_) co_return true;
  if (admitted_.starts != nullptr) {
    const auto marking = std::make_shared<Marking>(timer_);
    const std::unique_ptr<Marking, StopWaiting> end(marking.get());
    timer_.expires_after(admitted_.starts->patience());
    admitted_.starts->mark(admitted_.command.number,
                           [marking](bool may_be_sent) { marking->answer(may_be_sent); });
    co_await timer_.async_wait(use_result);
    is_unmarked_ = !marking->stop_waiting();
    if (is_unmarked_) co_return false;
  }
  is_started_ = true;
  // From here on, a crash leaves the outcome of the command unknown.
  failpoint("command_started");
  co_return true;
}

bool CommandExchanges::is_of_gateway(const Exchange& exchange) const {
  return exchange.is_nak() && station_.codec->is_from_gateway(exchange.reply.device_code);
}

/// Adds what to check if nothing was ever answered on this channel, or only by a gateway.
void CommandExchanges::add_hint(Exchange& exchange) const {
  if (device_.protocol == nullptr) return;
  if (is_of_gateway(exchange) && !answered_)
    exchange.reply.text =
        "\"" + exchange.reply.text +
        "\": " + checklist_of(device_, *station_.codec, station_.wiring, Answers::of_gateway);
  if (bus_.channel().was_ever_answered()) return;
  const bool is_silent = exchange.outcome == Exchange::Outcome::unanswered;
  const bool is_closed =
      bus_.channel().closed_unanswered() && !bus_.channel().transport().has_datagrams();
  if (is_silent && exchange.received.empty())
    exchange.error = checklist_of(device_, *station_.codec, station_.wiring, Answers::none);
  else if (const auto text = checklist_of_closed(*device_.protocol, *station_.codec);
           is_closed && !text.empty())
    exchange.error.append("; ").append(text);
}

asio::awaitable<Exchange> CommandExchanges::ask(Request request, SteadyTime not_after,
                                                Effect effect) {
  using Outcome = Exchange::Outcome;
  if (std::exchange(was_silent_, false) && co_await sharing_.give_way_after_silence())
    part_began_.reset();
  // No need to open a channel or to enquire.
  if (Clock::now() > not_after) co_return Exchange::unsent(Outcome::expired, {});
  Exchange exchange;
  // A channel that proves to be closed before a byte was sent is reopened once.
  for (int attempt = 0; attempt < 2; ++attempt) {
    if (!sharing_.may_send()) co_return cut_off();
    if (!bus_.is_open()) {
      const auto opened = co_await bus_.open();
      if (!opened) {
        exchange = Exchange::unsent(Outcome::link_down, opened.error().text);
        add_hint(exchange);
        co_return exchange;
      }
    }
    bool may_be_sent = true;
    if (effect == Effect::change) may_be_sent = co_await mark_started();
    if (!may_be_sent)
      co_return Exchange::unsent(Outcome::link_down,
                                 "the store's disk does not respond; nothing was sent");
    // The opening and the mark take time.
    if (effect == Effect::change && is_stopping()) co_return cut_off();
    exchange = co_await bus_.exchange(station_, request, not_after);
    if (exchange.outcome != Outcome::link_down || exchange.sent) break;
  }
  if (exchange.outcome == Outcome::link_down && !sharing_.may_send()) cut_off_ = true;
  add_hint(exchange);
  if (!exchange.received.empty()) {
    const auto guess = looks_like(device_, *station_.codec, exchange.asked, exchange.received);
    if (guess.cause != UnexpectedBytes::Cause::unknown)
      exchange.error += "; it looks like " + guess.text;
  }
  if (exchange.sent) {
    if (!first_byte_) first_byte_ = exchange.began;
    if (!part_began_) part_began_ = exchange.began - exchange.rest;
    last_byte_ = exchange.ended;
  }
  if (exchange.has_answer() && !is_of_gateway(exchange)) answered_ = true;
  if (exchange.outcome == Outcome::unanswered) unanswered_ = true;
  was_silent_ = exchange.outcome == Outcome::unanswered || is_of_gateway(exchange);
  if (was_silent_) sharing_.was_silent(exchange.line_time());
  co_return exchange;
}

asio::awaitable<CommandExchanges::ReadBack> CommandExchanges::read_point(
    const AdmittedTarget& target) {
  ReadBack out;
  const Plan plan = reads_of(*station_.codec, device_, target.point, limits_);
  std::vector<Bytes> images(plan.reads.size());
  for (std::uint32_t e = 0; e < plan.exchange_count(); ++e) {
    const ReadIndices reads = plan.exchanges[e];
    const Request request = plan.request(reads);
    if (e > 0) {
      const bool going_on = co_await go_on(gives_way(target));
      if (!going_on && target.requests.empty()) {  // after a write, the read-back goes on
        out.last = cut_off();
        co_return out;
      }
    }
    for (int attempt = 0; attempt <= device_.retries; ++attempt) {
      out.last = co_await ask(request, latest_start());
      const bool cured = out.last.is_data();
      std::optional<RefusalMeaning> refusal;
      if (out.last.is_nak())
        refusal = station_.codec->meaning_of(request, out.last.reply.device_code);
      const bool worth_repeating = out.last.outcome == Exchange::Outcome::garbled ||
                                   refusal == RefusalMeaning::curable ||
                                   refusal == RefusalMeaning::busy;
      if (cured || !worth_repeating) break;
      if (refusal == RefusalMeaning::busy) co_await pause(kBusyPause);
    }
    if (!out.last.is_data()) co_return out;
    plan.share_out(reads, std::move(out.last.reply.image), images);
  }
  auto image = image_of(plan, images, target.point, 0);
  if (image)
    out.image = std::move(*image);
  else
    out.last.error = image.error().text;
  co_return out;
}

asio::awaitable<void> CommandExchanges::pause(milliseconds duration) {
  return wait_until(timer_, Clock::now() + duration);
}

asio::awaitable<Exchange> CommandExchanges::send(Request request, Try which) {
  // Contract: a second try must begin before the expiry, even if the command is in progress.
  const auto not_after = [&] { return which == Try::first ? latest_start() : admitted_.deadline; };
  if (const auto first = station_.codec->read_before(request)) {
    Exchange reading = co_await ask(*first, not_after());
    if (!reading.is_data()) {
      reading.sent = false;  // the command itself was not sent
      co_return reading;
    }
    request = station_.codec->with_read(request, reading.reply.image);
  }
  Exchange exchange = co_await ask(std::move(request), not_after(), Effect::change);
  if (exchange.sent) ++writes_;
  co_return exchange;
}

asio::awaitable<Exchange> CommandExchanges::send_once_or_twice(Request request, bool may_repeat) {
  const Codec& codec = *station_.codec;
  Exchange exchange = co_await send(request, Try::first);
  if (!may_repeat || !exchange.sent || !exchange.is_nak()) co_return exchange;
  const int code = exchange.reply.device_code;
  const RefusalMeaning meaning = codec.meaning_of(request, code);
  const auto other = codec.instead_of(request, code);
  if (other)
    request = *other;
  else if (meaning != RefusalMeaning::curable && meaning != RefusalMeaning::busy)
    co_return exchange;
  if (meaning == RefusalMeaning::busy) co_await pause(kBusyPause);
  if (is_stopping()) co_return exchange;
  Exchange second = co_await send(request, Try::second);
  // Too late for a second try: the answer to the first one stands.
  if (second.outcome == Exchange::Outcome::expired) co_return exchange;
  co_return second;
}

}  // namespace fxagent
