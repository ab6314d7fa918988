#include "agent/field/command/command_execution.h"

#include <algorithm>
#include <utility>

#include "agent/commands/result.h"
#include "agent/field/command/command_line_time.h"
#include "protocol/plan/plan.h"
#include "protocol/value/pack.h"

namespace fxagent {
namespace {

using std::chrono::milliseconds;
using Clock = std::chrono::steady_clock;

// Interval between reads of the RUN state after RUN or STOP.
constexpr milliseconds kRunStateEvery{100};

Reason reason_of(const Exchange& exchange) {
  switch (exchange.outcome) {
    case Exchange::Outcome::garbled:
      return Reason::bad_frame;
    case Exchange::Outcome::link_down:
      return Reason::link_down;
    case Exchange::Outcome::expired:
      return Reason::expired;
    case Exchange::Outcome::unanswered:
      return exchange.sent ? Reason::timeout : Reason::device_offline;
    case Exchange::Outcome::answered:
      break;
  }
  return exchange.is_nak() ? Reason::nak : Reason::bad_frame;
}

void set(TargetResult& out, CommandStatus status, Reason reason, std::string detail) {
  out.status = status;
  out.reason = reason;
  out.detail = std::move(detail);
}

std::string nak_text(const Exchange& exchange) {
  return exchange.reply.text.empty() ? "nak: the protocol gives no reason" : exchange.reply.text;
}

/// Returns what came in place of an ACK of a write that was carried out, for people.
std::string no_ack_text(const Exchange& lost) {
  if (lost.is_nak()) return "a refusal that leaves the outcome open";
  const bool silent = lost.outcome == Exchange::Outcome::unanswered && lost.received.empty();
  return silent ? "no answer" : "no valid answer (" + lost.error + ")";
}

/// Returns the number of parts that progress counts: elements of an array, characters of a string,
/// otherwise requests.
std::uint32_t parts_of(const AdmittedTarget& target) {
  if (target.point.is_array) return target.point.count;
  if (target.point.type == DataType::string) return target.point.length;
  return static_cast<std::uint32_t>(target.requests.size());
}

/// Returns the progress of a target whose first `frames` requests were carried out.
Progress progress_of(const AdmittedTarget& target, std::size_t frames) {
  const std::uint32_t of = parts_of(target);
  if (frames >= target.requests.size()) return {of, of};
  if (of == target.requests.size() || of == 0) return {static_cast<std::uint32_t>(frames), of};
  const Span span = *span_of(target.point);
  std::uint64_t end = span.first_bit;
  for (std::size_t i = 0; i < frames; ++i) {
    if (const auto* write = std::get_if<Write>(&target.requests[i]))
      end = write->span.end_bit();
    else if (const auto* force = std::get_if<Force>(&target.requests[i]))
      end = std::uint64_t{force->bit} + 1;
  }
  const std::uint64_t bits = end - span.first_bit;
  const bool is_text = target.point.type == DataType::string && !target.point.is_array;
  // The last word of a string of odd length holds one character only, so progress is not
  // proportional to its bits.
  const std::uint64_t done = is_text ? bits / 8 : bits * of / span.bits;
  return {static_cast<std::uint32_t>(std::min<std::uint64_t>(done, of)), of};
}

/// True if the target was carried out, whatever has changed it since.
bool was_carried_out(const TargetResult& target) {
  return target.status == CommandStatus::succeeded ||
         (target.status == CommandStatus::failed && target.reason == Reason::verify_mismatch);
}

std::string elsewhere_text(const AdmittedTarget& target, const Value& read) {
  return target.point.address.text + " holds another value" + (read.is_array ? "" : " now") +
         ": the device did not take the value or limited it, or something else changed it after "
         "the write";
}

/// The answer behind the ACK may belong to this command, and the ACK to an earlier one.
void set_doubtful_ack(TargetResult& out, const std::string& found) {
  out.plc = PlcAnswer::none;
  set(out, CommandStatus::unknown_outcome, Reason::bad_frame,
      "acknowledged, but another answer followed the ACK, and " + found);
}

Verification verification(const AdmittedTarget& target, const Bytes& image) {
  Verification out;
  out.match = with_padding_of(target.point, image, target.image) == target.image;
  const Span span = *span_of(target.point);
  if (const auto value = unpack(target.point, image, span.first_bit)) out.read = *value;
  return out;
}

/// True if `target` overlaps another target of the command, so that their sequence matters.
bool meets_another(const AdmittedCommand& admitted, const AdmittedTarget& target) {
  const Span span = *span_of(target.point);
  return std::ranges::any_of(admitted.targets, [&](const AdmittedTarget& other) {
    return &other != &target && overlap(span, *span_of(other.point));
  });
}

bool surely_without_effect(const Codec& codec, const Request& request, const Exchange& exchange) {
  if (!exchange.sent) return true;
  if (!exchange.is_nak()) return false;
  return codec.meaning_of(request, exchange.reply.device_code) != RefusalMeaning::unclear;
}

/// Sets the outcome of a target that BusSharing::why_stopping() left unsent.
void set_unsent(TargetResult& out, Reason why_stopping) {
  set(out, status_of_unsent(why_stopping), why_stopping,
      why_not_sent(why_stopping) + "; nothing was sent");
}

/// Sets the outcome of the command from those of its targets, of which there is at least one.
void summarise(CommandResult& result) {
  const auto telling = std::ranges::find_if_not(result.targets, [](const TargetResult& target) {
    return target.status == CommandStatus::succeeded;
  });
  static_cast<CommandOutcome&>(result) =
      telling == result.targets.end() ? result.targets.back() : *telling;
  if (!result.is_list) return;
  result.progress.reset();
  const auto done = std::count_if(result.targets.begin(), result.targets.end(), was_carried_out);
  const bool open = result.status == CommandStatus::unknown_outcome;
  const bool without =
      result.status == CommandStatus::failed || result.status == CommandStatus::rejected;
  const bool broken_off = done > 0 && static_cast<std::size_t>(done) < result.targets.size();
  if (without && broken_off) result.status = CommandStatus::partial;
  if (open || result.status == CommandStatus::partial)
    result.progress = Progress{static_cast<std::uint32_t>(done),
                               static_cast<std::uint32_t>(result.targets.size())};
}

}  // namespace

CommandExecution::CommandExecution(asio::any_io_executor executor, Bus& bus, Station& station,
                                   const DeviceConfig& device, std::span<const Holes::Limit> limits,
                                   const AdmittedCommand& admitted, BusSharing& sharing)
    : station_(station),
      admitted_(admitted),
      sharing_(sharing),
      wire_(executor, bus, station, device, limits, admitted, sharing),
      result_(result_of(admitted.command)) {}

asio::awaitable<CommandResult> CommandExecution::run() {
  result_.targets.clear();
  if (admitted_.interrupted) {
    co_await settle_interrupted();
  } else if (admitted_.run_request) {
    result_.targets.emplace_back();
    co_await run_or_stop();
  } else {
    co_await run_targets();
  }
  result_.attempts += wire_.writes();
  if (!wire_.first_byte()) {
    result_.queue = Clock::now() - admitted_.queued;
  } else {
    result_.queue = *wire_.first_byte() - admitted_.queued;
    result_.wire = wire_.last_byte() - *wire_.first_byte();
  }
  summarise(result_);
  co_return std::move(result_);
}

void CommandExecution::set_without_effect(TargetResult& out, const Exchange& exchange) const {
  if (exchange.is_nak()) {
    out.plc = PlcAnswer::nak;
    set(out, CommandStatus::failed, Reason::nak, nak_text(exchange));
  } else if (exchange.outcome == Exchange::Outcome::expired) {
    const auto left = admitted_.deadline - Clock::now();
    std::string detail = "the command expired before it could be sent";
    if (left.count() > 0 && admitted_.line_time)
      detail = "it takes " +
               std::to_string(std::chrono::ceil<milliseconds>(*admitted_.line_time).count()) +
               " ms on the line, and " +
               std::to_string(std::chrono::floor<milliseconds>(left).count()) + " ms were left";
    set(out, CommandStatus::expired, Reason::expired, std::move(detail));
  } else if (wire_.was_cut_off()) {
    set_unsent(out, sharing_.why_stopping());
  } else if (wire_.is_unmarked()) {
    set(out, CommandStatus::failed, Reason::store_unavailable, exchange.error);
  } else {
    set(out, CommandStatus::failed, reason_of(exchange), exchange.error);
  }
}

asio::awaitable<void> CommandExecution::run_targets() {
  bool done = false;
  if (admitted_.command.is_list) done = co_await write_together();
  if (done) co_return;
  bool going = true;
  for (const AdmittedTarget& target : admitted_.targets) {
    TargetResult out = fxagent::result_of(target);
    const bool going_on = co_await wire_.go_on(/*share=*/going && !result_.targets.empty());
    if (!going) {
      set(out, CommandStatus::failed, Reason::none, "not sent: an earlier target did not succeed");
    } else if (!going_on) {
      set_unsent(out, sharing_.why_stopping());
    } else if (target.requests.empty()) {
      co_await read_target(target, out);
    } else {
      co_await write_target(target, out);
    }
    going = going && (out.status == CommandStatus::succeeded || out.reason == Reason::broadcast);
    conclude_target(std::move(out));
  }
}

void CommandExecution::conclude_target(TargetResult out) {
  result_.targets.push_back(std::move(out));
  sharing_.concluded(result_.targets.size() - 1, result_.targets.back());
}

asio::awaitable<void> CommandExecution::read_target(const AdmittedTarget& target,
                                                    TargetResult& out) {
  CommandExchanges::ReadBack got = co_await wire_.read_point(target);
  if (wire_.first_byte()) ++result_.attempts;
  if (!got.image) co_return set_without_effect(out, got.last);
  auto value = unpack(target.point, *got.image, span_of(target.point)->first_bit);
  if (!value) co_return set(out, CommandStatus::failed, Reason::bad_value, value.error().text);
  out.plc = PlcAnswer::ack;
  out.value = std::move(*value);
  set(out, CommandStatus::succeeded, Reason::none, "");
}

asio::awaitable<bool> CommandExecution::read_first(const AdmittedTarget& target,
                                                   std::vector<Request>& requests,
                                                   TargetResult& out) {
  if (!is_read_first(*admitted_.codec, target)) co_return true;
  CommandExchanges::ReadBack got = co_await wire_.read_point(target);
  if (!got.image) {
    set_without_effect(out, got.last);
    co_return false;
  }
  Verification found = verification(target, *got.image);
  if (!target.expected || (found.read && shows(*found.read, *target.expected))) {
    if (has_padding(target.point)) {
      const auto whole = plan_write(*admitted_.codec, target.point,
                                    with_padding_of(target.point, target.image, *got.image));
      if (whole) requests = *whole;
    }
    co_return true;
  }
  const std::string why =
      found.read ? "the value differs from expect"
                 : unpack(target.point, *got.image, span_of(target.point)->first_bit).error().text;
  out.verify = std::move(found);
  out.verify->match = false;
  set(out, CommandStatus::failed, Reason::expect_mismatch, "nothing was written: " + why);
  co_return false;
}

asio::awaitable<void> CommandExecution::conclude(const AdmittedTarget& target, Exchange exchange,
                                                 TargetResult& out) {
  if (!exchange.is_ack()) {
    co_await settle_unknown(target, exchange, out);
  } else if (station_.codec->is_broadcast()) {
    set(out, CommandStatus::unknown_outcome, Reason::broadcast,
        std::string("no device answers a broadcast") +
            (has_padding(target.point) ? "; the other half of the last word was set to 0" : ""));
  } else {
    out.plc = PlcAnswer::ack;
    set(out, CommandStatus::succeeded, Reason::none, "");
    if (is_verified(admitted_, target)) co_await verify(target, out);
  }
}

asio::awaitable<void> CommandExecution::write_target(const AdmittedTarget& target,
                                                     TargetResult& out) {
  std::vector<Request> requests = target.requests;
  const bool as_expected = co_await read_first(target, requests, out);
  if (!as_expected) co_return;
  bool may_repeat = true;
  Exchange exchange;
  std::size_t carried_out = 0;
  for (; carried_out < requests.size(); ++carried_out) {
    const bool going_on = co_await wire_.go_on(carried_out > 0 && gives_way(target));
    if (!going_on) {
      set_unsent(out, sharing_.why_stopping());
      co_return co_await end_early(target, carried_out, out);
    }
    const int before = wire_.writes();
    exchange = co_await wire_.send_once_or_twice(requests[carried_out], may_repeat);
    if (wire_.writes() - before > 1) may_repeat = false;
    if (exchange.is_ack()) continue;
    if (!surely_without_effect(*station_.codec, requests[carried_out], exchange)) break;
    set_without_effect(out, exchange);
    co_return co_await end_early(target, carried_out, out);
  }
  co_await conclude(target, std::move(exchange), out);
  if (out.status == CommandStatus::unknown_outcome && carried_out < requests.size() &&
      requests.size() > 1)
    out.progress = progress_of(target, carried_out);
}

asio::awaitable<void> CommandExecution::end_early(const AdmittedTarget& target, std::size_t frames,
                                                  TargetResult& out) {
  if (frames == 0) co_return;
  out.status = CommandStatus::partial;
  out.progress = progress_of(target, frames);
  if (out.reason == sharing_.why_stopping())
    out.detail = why_not_sent(out.reason) + "; the rest was not sent";
  const CommandExchanges::ReadBack got = co_await wire_.read_point(target);
  if (got.image) out.verify = verification(target, *got.image);
}

asio::awaitable<bool> CommandExecution::write_together() {
  std::vector<Request> requests;
  for (const AdmittedTarget& target : admitted_.targets) {
    if (target.requests.size() != 1 || is_read_first(*admitted_.codec, target)) co_return false;
    if (meets_another(admitted_, target)) co_return false;
    requests.push_back(target.requests.front());
  }
  const auto together = station_.codec->combine(requests);
  if (!together) co_return false;
  if (wire_.is_stopping()) co_return false;
  const Exchange exchange = co_await wire_.send_once_or_twice(*together, true);
  result_.one_frame = wire_.writes() > 0;
  const bool no_effect =
      !exchange.is_ack() && surely_without_effect(*station_.codec, *together, exchange);
  if (!no_effect) sharing_.written_together(exchange);
  for (const AdmittedTarget& target : admitted_.targets) {
    TargetResult out = fxagent::result_of(target);
    if (no_effect) {
      set_without_effect(out, exchange);
    } else {
      // All targets were carried out, or the outcome is unknown. Only a read-back waits for others.
      const bool is_read = !exchange.is_ack() || is_verified(admitted_, target);
      if (is_read && !result_.targets.empty()) co_await wire_.go_on(/*share=*/true);
      co_await conclude(target, exchange, out);
    }
    conclude_target(std::move(out));
  }
  co_return true;
}

asio::awaitable<void> CommandExecution::verify(const AdmittedTarget& target, TargetResult& out) {
  const std::uint64_t findings = wire_.findings();
  CommandExchanges::ReadBack got = co_await wire_.read_point(target);
  if (!got.image) {
    out.detail = "acknowledged; it could not be read back: " +
                 (got.last.is_nak() ? nak_text(got.last) : got.last.error);
    co_return;
  }
  out.verify = verification(target, *got.image);
  if (out.verify->match) co_return;
  if (wire_.findings() != findings) co_return set_doubtful_ack(out, "the value read back differs");
  set(out, CommandStatus::failed, Reason::verify_mismatch,
      elsewhere_text(target, out.verify->read.value_or(Value())));
}

void CommandExecution::set_unknown(TargetResult& out, const Exchange& lost) const {
  if (wire_.was_cut_off())
    set(out, CommandStatus::unknown_outcome, sharing_.why_stopping(),
        why_not_sent(sharing_.why_stopping()) + "; there was no answer until then");
  else
    set(out, CommandStatus::unknown_outcome, reason_of(lost),
        lost.is_nak() ? nak_text(lost) : lost.error);
}

asio::awaitable<void> CommandExecution::settle_unknown(const AdmittedTarget& target,
                                                       const Exchange& lost, TargetResult& out) {
  set_unknown(out, lost);
  // If the channel was lost, the outcome stays unknown. A channel closed to put it in order is
  // reopened.
  if (lost.outcome == Exchange::Outcome::link_down) co_return;
  co_await read_outcome(
      target, no_ack_text(lost) + ", but the value read back is the one to be written", out);
}

asio::awaitable<void> CommandExecution::read_outcome(const AdmittedTarget& target,
                                                     std::string succeeded, TargetResult& out) {
  CommandExchanges::ReadBack got = co_await wire_.read_point(target);
  if (!got.image) co_return;
  out.verify = verification(target, *got.image);
  if (out.verify->match) set(out, CommandStatus::succeeded, Reason::none, std::move(succeeded));
}

asio::awaitable<void> CommandExecution::settle_interrupted() {
  for (const AdmittedTarget& target : admitted_.targets) {
    TargetResult out = fxagent::result_of(target);
    if (!result_.targets.empty()) co_await wire_.go_on(admitted_.targets.size() > 1);
    set(out, CommandStatus::unknown_outcome, Reason::interrupted, std::string(kInterrupted));
    co_await read_outcome(
        target, "the agent ended during the command; the value read back is the one to be written",
        out);
    result_.targets.push_back(std::move(out));
  }
}

asio::awaitable<std::optional<bool>> CommandExecution::await_run_state(const PlcServices& plc,
                                                                       bool wanted) {
  std::optional<bool> state;
  const Request question = plc.run_state();
  const auto give_up = Clock::now() + kRunStateVerifiedWithin;
  for (;;) {
    const Exchange exchange = co_await wire_.ask(question, SteadyTime::max());
    if (exchange.is_data()) state = plc.run_state_from(exchange.reply.image);
    if (state == wanted || wire_.was_cut_off() || Clock::now() + kRunStateEvery > give_up)
      co_return state;
    co_await wire_.pause(kRunStateEvery);
  }
}

asio::awaitable<void> CommandExecution::run_or_stop() {
  TargetResult& out = result_.targets.front();
  const PlcServices& plc = *station_.codec->plc();  // not null: it made the admitted request
  const bool wanted = admitted_.command.op == Op::run;
  const Exchange exchange = co_await wire_.ask(*admitted_.run_request, wire_.latest_start(),
                                               CommandExchanges::Effect::change);
  if (exchange.sent) ++result_.attempts;
  if (!exchange.sent) co_return set_without_effect(out, exchange);
  if (exchange.is_ack()) out.plc = PlcAnswer::ack;
  // An unclear refusal, for example of a relay on the way, proves nothing.
  const bool refused = surely_without_effect(*station_.codec, *admitted_.run_request, exchange);
  if (refused) out.plc = PlcAnswer::nak;
  const std::uint64_t findings = wire_.findings();
  const auto state = co_await await_run_state(plc, wanted);
  if (state) {
    Verification seen;
    seen.read = Value(Scalar(std::string(*state ? "run" : "stop")));
    seen.match = *state == wanted;
    out.verify = seen;
  }
  const std::string hint = plc.run_hint();
  if (state == wanted) {
    set(out, CommandStatus::succeeded, Reason::none, "");
  } else if (refused) {
    set(out, CommandStatus::failed, Reason::nak, nak_text(exchange) + "; " + hint);
  } else if (exchange.is_ack() && state && wire_.findings() != findings) {
    set_doubtful_ack(out, std::string("the PLC is ") + (*state ? "running" : "stopped"));
  } else if (exchange.is_ack() && state) {
    set(out, CommandStatus::failed, Reason::verify_mismatch,
        "acknowledged, but the PLC is still " + std::string(*state ? "running" : "stopped") + "; " +
            hint);
  } else if (exchange.is_ack()) {
    set(out, CommandStatus::succeeded, Reason::none, "acknowledged; the run state cannot be read");
  } else {
    set_unknown(out, exchange);
  }
}

}  // namespace fxagent
