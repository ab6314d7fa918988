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
// A device's own time is taken from so many exchanges, and a plan made for another one is made anew
// where the two differ by this factor and by more than the scheduling of a busy machine.
constexpr std::uint32_t kTurnaroundsKnown = 64;
constexpr double kOtherTurnaround = 1.5;
constexpr milliseconds kTurnaroundNoise{3};
// An overload is over when the line has a little to spare, so that the log stays quiet at the edge.
constexpr double kOverloadOver = 0.95;
// A device that says it is busy is asked again once it may have finished.
constexpr milliseconds kBusyPause{100};

BadReason bad_reason(const Exchange& exchange) {
  if (exchange.is_nak()) return BadReason::nak;
  switch (exchange.outcome) {
    case Exchange::Outcome::unanswered:
      return BadReason::timeout;
    case Exchange::Outcome::link_down:
      return BadReason::link_down;
    default:
      return BadReason::bad_frame;
  }
}

std::string milliseconds_text(nanoseconds duration) {
  return std::to_string(std::chrono::round<milliseconds>(duration).count());
}

}  // namespace

/// Copied for the moment that a plan takes: a plant has many tags and seldom a new plan.
std::vector<Point> LinkWorker::points_of(const Device& device, const GroupPoll& group) {
  std::vector<Point> points;
  points.reserve(group.report.tags().size());
  for (const std::uint32_t tag : group.report.tags())
    points.push_back(device.config.tags[tag].point);
  return points;
}

void LinkWorker::make_plan(Device& device, GroupPoll& group) {
  const LineCost cost = cost_of(device.config, config_.links[link_].char_time, device.turnaround);
  group.plan = fxagent::make_plan(*device.codec, points_of(device, group), cost,
                                  device.config.max_block_bytes, device.holes.holes());
  group.holes_version = device.holes.version();
  group.planned_turnaround = device.turnaround;
  group.begin(bus_.doubt().findings());
  scheduler_.set_exchanges(group.id, static_cast<std::uint32_t>(group.plan.reads.size()));
}

void LinkWorker::refresh_plan(Device& device, GroupPoll& group) {
  device.holes.retry(Clock::now());
  bool stale = group.holes_version != device.holes.version();
  if (device.turnarounds >= kTurnaroundsKnown) {
    const nanoseconds measured = device.turnaround_sum / device.turnarounds;
    device.turnarounds = 0;
    device.turnaround_sum = {};
    const auto [least, most] = std::minmax(measured, device.turnaround);
    if (most - least > kTurnaroundNoise &&
        static_cast<double>(most.count()) > static_cast<double>(least.count()) * kOtherTurnaround) {
      log::info("device", {{"device", device.config.name},
                           {"turnaround_ms", milliseconds_text(measured)},
                           {"planned_with_ms", milliseconds_text(device.turnaround)}});
      device.turnaround = measured;
    }
  }
  // Without a line speed a plan has the fewest exchanges, whatever they take.
  if (config_.links[link_].char_time.count() > 0)
    stale |= group.planned_turnaround != device.turnaround;
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
        const bool free_running = device->config.groups[group->group].interval.count() == 0;
        if (free_running && outbox_.is_backed_up()) {
          scheduler_.abandon_cycle(group->id, Clock::now() + kUplinkRest);
          co_return;
        }
        refresh_plan(*device, *group);
        group->begin(bus_.doubt().findings());
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
      if (group->plan.reads.empty()) {
        scheduler_.abandon_cycle(group->id, Clock::now() + kNothingToRead);
        finish_cycle(*device, *group);
        co_return;
      }
      const Read read = group->plan.reads[step.exchange].read;
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
  if (exchange.is_data()) {
    device.turnaround_sum += exchange.turnaround;
    ++device.turnarounds;
  }
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
  // In doubt each exchange takes its silences, and a repeat would not be believed either.
  bool repeatable = exchange.outcome == Exchange::Outcome::garbled && !bus_.doubt().is_doubted();
  if (exchange.is_nak()) {
    const Request asked = group.plan.reads[step.exchange].read;
    const auto meaning = device.codec->meaning_of(asked, exchange.reply.device_code);
    if (meaning == RefusalMeaning::unreachable) {
      note_unreachable(device);
      fail_cycle(device, group, BadReason::timeout);
      return;
    }
    repeatable = take_refusal(device, group, step, exchange, meaning);
  }
  if (repeatable && group.repeats < device.config.retries) {
    ++group.repeats;  // the poll scheduler offers the same step again, after the commands that wait
    return;
  }
  group.repeats = 0;
  if (exchange.is_data()) {
    device.holes.read(group.plan.reads[step.exchange].read.span);
    group.images[step.exchange] = std::move(exchange.reply.image);
  } else {
    group.failures[step.exchange] = bad_reason(exchange);
  }
  if (exchange.has_answer()) {
    if (!group.first_reply) group.first_reply = exchange.ended;
    group.last_reply = exchange.ended;
    group.last_reply_ms = exchange.ended_ms;
    ++group.replies;
  }
  // What a command wrote before this read is in the read; what it writes after it is newer.
  // An array cut into several reads keeps the whole that was written in between.
  for (const std::uint32_t point : group.plan.reads[step.exchange].points)
    if (group.plan.sources[point].first_read == step.exchange)
      group.newer.erase(group.report.tags()[point]);
  group.next_read = step.exchange + 1;
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
      const PlannedRead& planned = group.plan.reads[step.exchange];
      const auto halves = halves_of(*device.codec, points_of(device, group), planned);
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
  for (std::size_t i = 0; i < group.failures.size(); ++i)
    if (i >= group.next_read && group.images[i].empty() && !group.failures[i])
      group.failures[i] = why;
  scheduler_.abandon_cycle(group.id, bus_.is_open() ? Clock::now() : next_open_);
  finish_cycle(device, group);
}

void LinkWorker::finish_cycle(Device& device, GroupPoll& group) {
  const auto& tags = group.report.tags();
  // Foreign bytes during the cycle: any of its answers may be the wrong one.
  const bool doubtful = bus_.doubt().is_doubted() || bus_.doubt().findings() != group.findings;
  std::vector<TagOutcome> outcomes;
  outcomes.reserve(tags.size());
  for (std::size_t i = 0; i < tags.size(); ++i) {
    const PointSource source = group.plan.sources[i];
    if (const auto newer = group.newer.find(tags[i]); newer != group.newer.end()) {
      outcomes.emplace_back(newer->second);
      continue;
    }
    std::optional<BadReason> why;
    if (source.count == 0) {
      const auto& refused = group.plan.refused;
      const bool by_device = std::binary_search(refused.begin(), refused.end(), i);
      why = by_device ? BadReason::nak : BadReason::unsupported;
    }
    for (std::uint32_t r = source.first_read; r < source.first_read + source.count; ++r)
      if (!why) why = group.failures[r];
    if (!why && doubtful) why = BadReason::bad_frame;
    if (why) {
      outcomes.emplace_back(*why);
      continue;
    }
    auto value = value_of(group.plan, group.images, device.config.tags[tags[i]].point, i);
    if (value)
      outcomes.emplace_back(std::move(*value));
    else
      outcomes.emplace_back(BadReason::bad_value);
  }
  group.newer.clear();

  Telemetry message;
  message.ts_ms = group.replies > 0 ? group.last_reply_ms : now_ms();
  if (group.replies > 1) {
    const auto span = group.last_reply - *group.first_reply;
    message.span_ms = std::chrono::duration<double, std::milli>(span).count();
  }
  ++device.collected;
  auto readings = group.report.cycle(std::move(outcomes), message.ts_ms, Clock::now());
  if (readings) {
    message.readings = std::move(*readings);
    publish(device, group.group, std::move(message));
  } else {
    ++device.suppressed;
  }
  update_status(device);
}

void LinkWorker::publish(Device& device, std::uint32_t group, Telemetry message) {
  message.device = device.index;
  message.group = group;
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
