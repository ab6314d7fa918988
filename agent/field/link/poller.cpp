#include "agent/field/link/poller.h"

#include <algorithm>
#include <chrono>
#include <string>
#include <utility>
#include <vector>

#include "agent/line_time.h"
#include "agent/log/log.h"

namespace fxagent {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;
using Clock = std::chrono::steady_clock;
using Knowledge = ModelQuestions::Knowledge;

// Rest of a group without an interval if its plan has no reads: its device's model cannot read its
// tags, or refuses them all.
constexpr milliseconds kNothingToRead{1000};
// A group without an interval that is faster than the broker rests at least this long, and longer
// while that lasts.
constexpr std::chrono::microseconds kUplinkRest{500};
// Such a group begins a cycle about this often, also while the broker is away.
constexpr milliseconds kBehindInterval{1000};
// An overload ends when the line has a little to spare, so that the log stays quiet at the edge.
constexpr double kOverloadOver = 0.95;
// The RUN state is read this soon after it is due, however busy the groups keep the line.
constexpr milliseconds kQuestionWithin{2000};

asio::awaitable<void> nothing() { co_return; }

}  // namespace

Poller::Poller(const LinkParts& link, LinkState& state)
    : link_(link), state_(state), plans_(link), questions_(link, state, plans_) {}

// ---- groups -------------------------------------------------------------------------------------

nanoseconds Poller::add_groups(LinkDevice& device, nanoseconds after) {
  nanoseconds total{0};
  const SteadyTime from = first_time();
  for (std::uint32_t g = 0; g < device.config.groups.size(); ++g) {
    auto group = std::make_unique<GroupPoll>(device.config, g);
    if (group->cycle.tags().empty()) continue;
    // Each group begins when those before it should be finished. If the intervals are multiples of
    // each other, it meets them there again and again.
    const milliseconds interval = device.config.groups[g].interval;
    const nanoseconds begins = (after + total) % nanoseconds(std::max(interval, milliseconds(1)));
    group->id = link_.scheduler.add_group(device.id, interval, 1, on_grid(from + begins, interval));
    plans_.make(device, *group);
    total += group->cycle.reads().plan().line_time;
    device.groups.push_back(std::move(group));
  }
  return total;
}

void Poller::adjust_groups(LinkDevice& device, const std::vector<GroupConfig>& groups) {
  for (const auto& group : device.groups) {
    const GroupConfig& next = groups.at(group->cycle.group());
    if (next.interval != group->cycle.settings().interval)
      link_.scheduler.set_interval(group->id, next.interval, Clock::now());
    group->cycle.adjust(next);
  }
}

void Poller::add_question(LinkDevice& device) {
  if (!background_question(*device.codec, !device.config.tags.empty())) return;
  device.question_group = link_.scheduler.add_group(
      device.id, kQuestionInterval, 1, on_grid(first_time(), kQuestionInterval), kQuestionWithin);
}

/// Returns the time of the next open, or now if that has passed.
SteadyTime Poller::first_time() const { return std::max(Clock::now(), state_.next_open()); }

// ---- one step -----------------------------------------------------------------------------------

// Not a coroutine: a poll has one frame less that way.
asio::awaitable<void> Poller::run(PollScheduler::PollStep step) {
  for (const auto& device : link_.devices) {
    if (device->question_group == step.group) return questions_.run(*device, step);
    for (const auto& group : device->groups)
      if (group->id == step.group) return read_group(*device, *group, step);
  }
  return nothing();
}

bool Poller::begin_cycle(LinkDevice& device, GroupPoll& group,
                         const PollScheduler::PollStep& step) {
  const bool free_running = group.cycle.settings().interval.count() == 0;
  const SteadyTime now = Clock::now();
  const nanoseconds since = now - group.began;
  if (free_running && link_.outbox.is_backed_up() && since < kBehindInterval) {
    link_.scheduler.group(group.id).abandon_cycle(now +
                                                  std::max<nanoseconds>(kUplinkRest, since / 4));
    return false;
  }
  group.began = now;
  plans_.refresh(device, group);
  group.cycle.begin(link_.bus.doubt().findings());
  group.answers = GroupPoll::Answers::none;
  group.refusals = 0;
  group.refused_time = {};
  device.late_ms.add(step.late);
  if (const auto& durations = link_.bus.counters().durations) durations->lateness.add(step.late);
  return true;
}

asio::awaitable<void> Poller::read_group(LinkDevice& device, GroupPoll& group,
                                         PollScheduler::PollStep step) {
  if (step.starts_cycle && !begin_cycle(device, group, step)) co_return;
  if (!link_.bus.is_open()) co_return fail_cycle(device, group, BadReason::link_down);
  if (!device.state.is_model_known()) {
    BadReason failure = BadReason::timeout;
    const Knowledge knowledge = co_await questions_.ask_model(device, failure);
    if (failure == BadReason::bad_frame) note_invalid(group);
    if (knowledge == Knowledge::unanswered) fail_cycle(device, group, failure);
    if (knowledge != Knowledge::known) co_return;  // a new plan: the cycle is offered again
  }
  if (group.cycle.reads().plan().reads.empty()) {
    link_.scheduler.group(group.id).abandon_cycle(Clock::now() + kNothingToRead);
    finish_cycle(device, group);
    co_return;
  }
  // Data that a command may have changed is read first; then the same step is offered again.
  const Plan& plan = group.cycle.reads().plan();
  const auto outdated = group.cycle.reads().outdated();
  if (!outdated && group.cycle.reads().has_images(plan.exchanges[step.exchange]))
    co_return end_step(device, group, step);
  const ReadIndices reads = outdated ? ReadIndices(&*outdated, 1) : plan.exchanges[step.exchange];
  const Asked asked{reads, plan.request(reads), outdated.has_value()};
  Exchange exchange = co_await link_.bus.exchange(device.station, asked.request);
  take_reading(device, group, step, asked, std::move(exchange));
}

void Poller::note_invalid(GroupPoll& group) const {
  if (!link_.bus.is_open() && group.answers == GroupPoll::Answers::none)
    group.answers = GroupPoll::Answers::only_invalid;
}

void Poller::take_reading(LinkDevice& device, GroupPoll& group, const PollScheduler::PollStep& step,
                          const Asked& asked, Exchange exchange) {
  if (state_.is_stopping()) return;
  link_.scheduler.step_used(step, exchange.line_time());
  if (exchange.doubted) {  // the device is there, but its data is not trusted
    state_.answered(device);
    exchange.outcome = Exchange::Outcome::garbled;
  }
  if (exchange.has_answer()) group.answers = GroupPoll::Answers::valid;
  if (exchange.outcome == Exchange::Outcome::garbled) note_invalid(group);
  if (exchange.is_data()) device.turnaround.add(exchange.turnaround);
  state_.exchanged(device, exchange);
  if (!exchange.doubted && !link_.bus.doubt().is_doubted() &&
      (exchange.outcome == Exchange::Outcome::unanswered ||
       exchange.outcome == Exchange::Outcome::garbled))
    plans_.doubt_command(device, asked.request);
  if (exchange.outcome == Exchange::Outcome::unanswered)
    return fail_cycle(device, group, BadReason::timeout);
  if (exchange.is_data() && plans_.proves_command(device, asked.request)) return;
  if (exchange.outcome == Exchange::Outcome::link_down)
    return fail_cycle(device, group, BadReason::link_down);
  // While the bus is doubted, each exchange takes its silences, and a repeat would be doubted as
  // well.
  bool repeatable =
      exchange.outcome == Exchange::Outcome::garbled && !link_.bus.doubt().is_doubted();
  bool is_hole = false;
  if (exchange.is_nak()) {
    const Refusal refusal = take_refusal(device, group, step, asked, exchange);
    if (refusal == Refusal::ends_step) return;
    repeatable = refusal == Refusal::may_pass;
    is_hole = refusal == Refusal::is_hole;
  }
  // The poll scheduler offers the same step again after the waiting commands.
  if (repeatable && group.cycle.may_repeat()) return;
  if (exchange.is_data()) plans_.were_read(device, group, asked.reads);
  const nanoseconds line_time = exchange.line_time();
  group.cycle.take(asked.reads, std::move(exchange));
  if (asked.again) return;
  if (is_hole) plans_.read_in_parts(device, group, asked.reads, line_time);
  end_step(device, group, step);
}

void Poller::end_step(LinkDevice& device, GroupPoll& group, const PollScheduler::PollStep& step) {
  if (!link_.scheduler.step_done(step)) return;
  note_load();
  finish_cycle(device, group);
}

void Poller::note_load() {
  const double load = link_.scheduler.load();
  if (overloaded_ ? load > kOverloadOver : load <= 1.0) return;
  overloaded_ = !overloaded_;
  const std::string percent = std::to_string(static_cast<int>(100 * load + 0.5));
  if (overloaded_)
    log::warn("link",
              {{"link", link_.config.name},
               {"load_percent", percent},
               {"note",
                "the groups ask for more than the line carries; the agent polls all of them "
                "less often, in proportion: see fxagent plan"}});
  else
    log::info("link", {{"link", link_.config.name}, {"load_percent", percent}});
}

Poller::Refusal Poller::take_refusal(LinkDevice& device, GroupPoll& group,
                                     const PollScheduler::PollStep& step, const Asked& asked,
                                     const Exchange& exchange) {
  const std::string& reason = exchange.reply.text;
  const auto meaning = device.codec->meaning_of(asked.request, exchange.reply.device_code);
  if (meaning == RefusalMeaning::unreachable) {
    fail_cycle(device, group, BadReason::timeout);
    return Refusal::ends_step;
  }
  const auto* gather = std::get_if<Gather>(&asked.request);
  if (meaning == RefusalMeaning::final && gather != nullptr) {
    plans_.give_up_command(device, gather->parts.front().gather, reason);
    return Refusal::ends_step;
  }
  if (meaning == RefusalMeaning::final || meaning == RefusalMeaning::unclear)
    device.log_refusal_once(reason);
  switch (meaning) {
    case RefusalMeaning::busy:
      link_.scheduler.group(step.group).postpone(exchange.ended + kBusyPause);
      return Refusal::may_pass;
    case RefusalMeaning::curable:
      return Refusal::may_pass;
    case RefusalMeaning::hole:
      plans_.refused(device, group, asked.reads, asked.request, exchange);
      return Refusal::is_hole;
    default:
      return Refusal::is_final;
  }
}

void Poller::fail_cycle(LinkDevice& device, GroupPoll& group, BadReason why) {
  group.cycle.reads().give_up(why);
  link_.scheduler.group(group.id).abandon_cycle(link_.bus.is_open() ? Clock::now()
                                                                    : state_.next_open());
  finish_cycle(device, group);
}

void Poller::finish_cycle(LinkDevice& device, GroupPoll& group) {
  ++device.collected;
  if (group.answers == GroupPoll::Answers::valid) link_.scheduler.had_valid(group.id);
  if (group.answers == GroupPoll::Answers::only_invalid)
    link_.scheduler.only_invalid(group.id, Clock::now());
  auto message =
      group.cycle.finish(link_.bus.doubt().is_doubted(), link_.bus.doubt().findings(), utc_now_ms(),
                         Clock::now(), link_.scheduler.next_poll(group.id));
  for (const NoValue& none : group.cycle.take_no_values()) {
    const TagConfig& tag = device.config.tags[none.tag];
    log::warn("tag", {{"device", device.config.name},
                      {"tag", std::string(tag.name)},
                      {"address", std::string(tag.point.address.text)},
                      {"reason", none.why},
                      {"note", none.hint.empty() ? "are its address and type right?" : none.hint}});
  }
  if (message)
    publish(device, std::move(*message));
  else
    ++device.suppressed;
  state_.update(device);
  if (device.state.reported().state == DeviceStatus::State::online) device.logged_refusals.clear();
}

void Poller::publish(LinkDevice& device, Telemetry message) {
  message.device = device.index;
  message.seq = ++device.seq;
  link_.outbox.push(std::move(message));
}

void Poller::overwritten(LinkDevice& device, const Span& span, const Bytes* image, BadReason why) {
  for (const auto& group : device.groups) group->cycle.overwritten(span, image, why);
}

void Poller::publish_written(LinkDevice& device, std::uint32_t tag, Value value, Origin origin) {
  for (const auto& group : device.groups) {
    if (group->cycle.group() != device.config.tags[tag].group) continue;
    Telemetry message = group->cycle.written(tag, std::move(value), utc_now_ms());
    message.written = origin == Origin::written;
    ++device.collected;
    publish(device, std::move(message));
    return;
  }
}

}  // namespace fxagent
