// Polls of a link: their plans, their readings, and what a refusal tells of a device.
#include <algorithm>
#include <utility>

#include "agent/field/link_device.h"
#include "agent/line_time.h"
#include "agent/log/log.h"
#include "protocol/plc.h"

namespace fxagent {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;
using Clock = std::chrono::steady_clock;

// How long a group without an interval rests where no way of its device's model reaches its tags.
constexpr milliseconds kNothingToRead{1000};
// A group without an interval that is faster than the broker looks again so soon.
constexpr std::chrono::microseconds kUplinkRest{500};
// An overload is over when the line has a little to spare, so that the log stays quiet at the edge.
constexpr double kOverloadOver = 0.95;
// A device that says it is busy is asked again once it may have finished.
constexpr milliseconds kBusyPause{100};

std::string milliseconds_text(nanoseconds duration) {
  return std::to_string(std::chrono::round<milliseconds>(duration).count());
}

}  // namespace

void LinkWorker::make_plan(Device& device, GroupPoll& group) {
  group.turnaround = device.turnaround.value();
  group.holes_version = device.holes.version();
  const LineCost cost = cost_of(device.config, config_.links[link_].char_time, group.turnaround);
  group.cycle.use(fxagent::make_plan(*device.codec, group.cycle.points(), cost,
                                     device.config.max_block_bytes, device.holes.holes()),
                  bus_.doubt().findings());
  scheduler_.set_exchanges(group.id, static_cast<std::uint32_t>(group.cycle.plan().reads.size()));
}

void LinkWorker::refresh_plan(Device& device, GroupPoll& group) {
  device.holes.retry(Clock::now());
  bool stale = group.holes_version != device.holes.version();
  const nanoseconds planned_with = device.turnaround.value();
  if (device.turnaround.review())
    log::info("device", {{"device", device.config.name},
                         {"turnaround_ms", milliseconds_text(device.turnaround.value())},
                         {"planned_with_ms", milliseconds_text(planned_with)}});
  // Without a line speed a plan has the fewest exchanges, whatever they take.
  if (config_.links[link_].char_time.count() > 0)
    stale |= group.turnaround != device.turnaround.value();
  if (stale) make_plan(device, group);
}

asio::awaitable<void> LinkWorker::run_step(PollScheduler::PollStep step) {
  for (const auto& device : devices_) {
    if (device->run_state_group == step.group) {
      co_await read_run_state(*device, step);
      co_return;
    }
    for (const auto& group : device->groups) {
      if (group->id != step.group) continue;
      if (step.starts_cycle) {
        const bool free_running = device->config.groups[group->cycle.group()].interval.count() == 0;
        if (free_running && outbox_.is_backed_up()) {
          scheduler_.abandon_cycle(group->id, Clock::now() + kUplinkRest);
          co_return;
        }
        refresh_plan(*device, *group);
        group->cycle.begin(bus_.doubt().findings());
        device->late_ms.add(step.late);
      }
      if (!bus_.is_open()) {
        fail_cycle(*device, *group, BadReason::link_down);
        co_return;
      }
      BadReason failure = BadReason::timeout;
      const Knowledge knowledge = co_await know_model(*device, failure);
      if (knowledge == Knowledge::unanswered) fail_cycle(*device, *group, failure);
      if (knowledge != Knowledge::known) co_return;  // under a new plan the cycle is offered again
      const Plan& plan = group->cycle.plan();
      if (plan.reads.empty()) {
        scheduler_.abandon_cycle(group->id, Clock::now() + kNothingToRead);
        finish_cycle(*device, *group);
        co_return;
      }
      const Read read = plan.reads[step.exchange].read;
      Exchange exchange = co_await bus_.exchange(device->station, read);
      take_reading(*device, *group, step, std::move(exchange));
      co_return;
    }
  }
}

void LinkWorker::take_reading(Device& device, GroupPoll& group, const PollScheduler::PollStep& step,
                              Exchange exchange) {
  if (stopping_) return;
  scheduler_.step_used(step, exchange.ended - exchange.began);
  if (exchange.doubted) {  // the device is there; what it says is not believed
    note_answer(device);
    exchange.outcome = Exchange::Outcome::garbled;
  }
  if (exchange.is_data()) device.turnaround.add(exchange.turnaround);
  if (exchange.is_ack() || exchange.is_data()) note_answer(device);
  if (exchange.outcome == Exchange::Outcome::unanswered) {
    note_silence(device);
    fail_cycle(device, group, BadReason::timeout);
    return;
  }
  if (exchange.outcome == Exchange::Outcome::link_down) {
    line_lost(exchange.error);
    fail_cycle(device, group, BadReason::link_down);
    return;
  }
  const PlannedRead& planned = group.cycle.plan().reads[step.exchange];
  // In doubt each exchange takes its silences, and a repeat would not be believed either.
  bool repeatable = exchange.outcome == Exchange::Outcome::garbled && !bus_.doubt().is_doubted();
  if (exchange.is_nak()) {
    const Request asked = planned.read;
    const auto meaning = device.codec->meaning_of(asked, exchange.reply.device_code);
    if (meaning == RefusalMeaning::unreachable) {
      note_unreachable(device);
      fail_cycle(device, group, BadReason::timeout);
      return;
    }
    repeatable = take_refusal(device, group, step, exchange, meaning);
  }
  // The poll scheduler offers the same step again, after the commands that wait.
  if (repeatable && group.cycle.may_repeat()) return;
  if (exchange.is_data()) device.holes.read(planned.read.span);
  group.cycle.take(step.exchange, std::move(exchange));
  if (!scheduler_.step_done(step)) return;
  note_load();
  finish_cycle(device, group);
}

void LinkWorker::note_load() {
  const double load = scheduler_.load();
  if (overloaded_ ? load > kOverloadOver : load <= 1.0) return;
  overloaded_ = !overloaded_;
  const std::string percent = std::to_string(static_cast<int>(100 * load + 0.5));
  if (overloaded_)
    log::warn("link", {{"link", config_.links[link_].name},
                       {"load_percent", percent},
                       {"note",
                        "the groups ask for more than the line carries; all are polled "
                        "less often, in proportion: see fxagent plan"}});
  else
    log::info("link", {{"link", config_.links[link_].name}, {"load_percent", percent}});
}

bool LinkWorker::take_refusal(Device& device, GroupPoll& group, const PollScheduler::PollStep& step,
                              const Exchange& exchange, RefusalMeaning meaning) {
  note_answer(device);
  switch (meaning) {
    case RefusalMeaning::busy:
      scheduler_.postpone(step, exchange.ended + kBusyPause);
      return true;
    case RefusalMeaning::hole: {
      const PlannedRead& planned = group.cycle.plan().reads[step.exchange];
      const auto halves = halves_of(*device.codec, group.cycle.points(), planned);
      // Plans change between cycles only: this one goes on, and what it does bring is published.
      device.holes.refused(planned.read.span, halves, exchange.ended);
      if (!halves)
        log::warn("device", {{"device", device.config.name},
                             {"refused", device.codec->addresses().name_of(planned.read.span)},
                             {"reason", exchange.reply.text}});
      return false;
    }
    default:
      return meaning == RefusalMeaning::curable;
  }
}

void LinkWorker::fail_cycle(Device& device, GroupPoll& group, BadReason why) {
  group.cycle.give_up(why);
  scheduler_.abandon_cycle(group.id, bus_.is_open() ? Clock::now() : next_open_);
  finish_cycle(device, group);
}

void LinkWorker::finish_cycle(Device& device, GroupPoll& group) {
  ++device.collected;
  auto message = group.cycle.finish(bus_.doubt().is_doubted(), bus_.doubt().findings(), now_ms(),
                                    Clock::now());
  if (message)
    publish(device, std::move(*message));
  else
    ++device.suppressed;
  update_status(device);
}

void LinkWorker::publish(Device& device, Telemetry message) {
  message.device = device.index;
  message.seq = ++device.seq;
  outbox_.push(std::move(message));
}

asio::awaitable<void> LinkWorker::read_run_state(Device& device, PollScheduler::PollStep step) {
  Knowledge knowledge = Knowledge::unanswered;
  BadReason failure = BadReason::link_down;
  if (bus_.is_open()) knowledge = co_await know_model(device, failure);
  if (knowledge != Knowledge::unanswered && bus_.is_open()) {
    const Request question = device.codec->plc()->run_state();
    const Exchange exchange = co_await bus_.exchange(device.station, question);
    if (stopping_) co_return;
    scheduler_.step_used(step, exchange.ended - exchange.began);
    if (exchange.has_answer()) note_answer(device);
    if (exchange.outcome == Exchange::Outcome::unanswered) note_silence(device);
    if (exchange.outcome == Exchange::Outcome::link_down) line_lost(exchange.error);
    std::optional<bool> run;
    if (exchange.is_data() && !exchange.doubted)
      run = device.codec->plc()->run_state_from(exchange.reply.image);
    device.state.set_run(run);
  }
  scheduler_.step_done(step);
  update_status(device);
}

asio::awaitable<LinkWorker::Knowledge> LinkWorker::know_model(Device& device, BadReason& failure) {
  if (device.state.is_model_known()) co_return Knowledge::known;
  const PlcServices& asking = *device.config.codec->plc();  // else the model would be known
  const std::vector<Request> questions = asking.identify();
  std::vector<Bytes> images;
  for (const Request& question : questions) {
    const Exchange exchange = co_await bus_.exchange(device.station, question);
    if (stopping_) co_return Knowledge::unanswered;
    scheduler_.poll_used(exchange.ended - exchange.began);
    if (exchange.doubted) {
      note_answer(device);
      failure = BadReason::bad_frame;
      co_return Knowledge::unanswered;
    }
    if (exchange.has_answer()) {
      note_answer(device);
      images.push_back(exchange.is_data() ? exchange.reply.image : Bytes{});
      continue;
    }
    if (exchange.outcome == Exchange::Outcome::unanswered) note_silence(device);
    if (exchange.outcome == Exchange::Outcome::link_down) line_lost(exchange.error);
    failure = bad_reason(exchange);
    co_return Knowledge::unanswered;
  }
  const auto model = asking.model_from(images);
  device.state.set_model(model);
  if (!model) {
    log::warn("device", {{"device", device.config.name},
                         {"model", "unknown"},
                         {"note", "only what every model has is used; set model in the config"}});
  } else if (*model != model_of(*device.codec)) {
    log::info("device", {{"device", device.config.name}, {"model", *model}});
  }
  const std::string now_known = model.value_or("");
  const bool changed = now_known != model_of(*device.codec);
  if (changed) {
    device.codec = model ? asking.with_model(*model) : device.config.codec;
    device.station.codec = device.codec.get();
    for (const auto& group : device.groups) make_plan(device, *group);
  }
  update_status(device);
  co_return changed ? Knowledge::plan_changed : Knowledge::known;
}

}  // namespace fxagent
