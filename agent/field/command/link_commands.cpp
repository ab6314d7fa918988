#include "agent/field/command/link_commands.h"

#include <algorithm>
#include <utility>

#include "agent/commands/result.h"
#include "agent/failpoint.h"
#include "agent/field/bus/exchange.h"
#include "agent/field/command/command_execution.h"
#include "agent/field/command/command_line_time.h"
#include "agent/line_time.h"
#include "protocol/value/pack.h"

namespace fxagent {
namespace {

using std::chrono::nanoseconds;
using Clock = std::chrono::steady_clock;

/// Returns why a place has no value after a command that may have written it, until the next read.
BadReason bad_after(Reason reason) {
  switch (reason) {
    case Reason::nak:
      return BadReason::nak;
    case Reason::link_down:
      return BadReason::link_down;
    case Reason::bad_frame:
    case Reason::verify_mismatch:
      return BadReason::bad_frame;
    default:
      return BadReason::timeout;
  }
}

/// True if nothing of the target was carried out, as far as can be known.
bool without_effect(const TargetResult& outcome) {
  switch (outcome.status) {
    case CommandStatus::succeeded:
    case CommandStatus::partial:
    case CommandStatus::unknown_outcome:
      return false;
    default:
      return outcome.reason != Reason::verify_mismatch;
  }
}

}  // namespace

LinkCommands::LinkCommands(asio::any_io_executor executor, const LinkParts& link, LinkState& state,
                           Poller& poller, LinkRecorder& recorder)
    : executor_(std::move(executor)),
      link_(link),
      state_(state),
      poller_(poller),
      recorder_(recorder) {}

void LinkCommands::add(AdmittedCommand admitted, LinkDevice& device) {
  WaitingCommand command;
  command.admitted = std::move(admitted);
  command.admitted.queued = Clock::now();
  command.device = &device;
  if (device.holes) command.read_limits = device.holes->command_limits();
  command.line_time = set_line_times(*command.admitted.codec, device.config, command.read_limits,
                                     link_.config.char_time, command.admitted);
  command.admitted.bound = bound_of(command);
  waiting_.push_back(std::move(command));
  link_.scheduler.share().command_waits();
}

void LinkCommands::refuse_waiting(Reason why, const LinkDevice* device) {
  std::erase_if(waiting_, [&](const WaitingCommand& waiting) {
    if (device != nullptr && waiting.device != device) return false;
    // Only its outcome is read.
    if (why == Reason::conflict && waiting.admitted.interrupted) return false;
    link_.scheduler.share().command_taken();
    link_.outbox.push(not_sent(waiting.admitted, why));
    return true;
  });
}

void LinkCommands::answer_running() {
  link_.scheduler.share().commands_are(static_cast<std::uint32_t>(waiting_.size()));
  for (const WaitingCommand& running : running_) {
    CommandResult result = result_of(running.admitted);
    set_outcome(result, CommandStatus::unknown_outcome, Reason::link_down,
                "a fault in the agent ended the link during the command");
    for (const AdmittedTarget& target : running.admitted.targets)
      if (!target.requests.empty())
        poller_.overwritten(*running.device, *span_of(target.point), nullptr, BadReason::link_down);
    recorder_.ended(result, running.device->config.name, std::nullopt);
    link_.outbox.push(std::move(result));
  }
  running_.clear();
}

nanoseconds LinkCommands::handshakes() const {
  nanoseconds total{0};
  for (const auto& device : link_.devices) {
    const auto enquiry = device->codec->resync();
    if (!enquiry || device->config.enquire != EnquirePolicy::open) continue;
    if (link_.bus.is_open() && device->station.handshake_in == link_.bus.channel().session())
      continue;
    const LineTiming timing = timing_of(device->config, link_.config.char_time);
    total += exchange_time(*device->codec, *enquiry, timing);
  }
  return total;
}

std::optional<nanoseconds> LinkCommands::bound_of(const WaitingCommand& command) const {
  if (link_.config.char_time.count() == 0) return std::nullopt;
  nanoseconds ahead{0};
  for (const WaitingCommand& running : running_) ahead += running.line_time;
  for (const WaitingCommand& waiting : waiting_) ahead += waiting.line_time;
  const nanoseconds own = command.line_time;
  const nanoseconds pause = std::max(link_.bus.not_before() - Clock::now(), nanoseconds(0));
  return handshakes() + pause +
         (gives_way(command.admitted)
              ? link_.scheduler.share().bound_giving_way(own, ahead, poller_.longest_poll())
              : link_.scheduler.share().bound(own, ahead, poller_.longest_poll()));
}

// ---- on the wire --------------------------------------------------------------------------------

/// Shares the bus between one command, the polls and the commands waiting behind it.
class LinkCommands::Sharing final : public BusSharing {
 public:
  Sharing(LinkCommands& commands, WaitingCommand& command)
      : commands_(commands), command_(command) {}

  /// Polls have their share as between commands. Waiting commands have as much line time as this
  /// one has used, in queue order. A short one runs after the first target; one as long as this one
  /// waits for its end. No command exceeds its bound that way.
  asio::awaitable<void> give_way(nanoseconds used) override {
    if (!at_a_target_) {
      within_ += used;
      command_.credit += used;
    }
    at_a_target_ = false;
    PollScheduler& scheduler = commands_.link_.scheduler;
    scheduler.share().command_waits();  // the rest of this one
    scheduler.command_used(used, Clock::now());
    // While the channel is closed, nothing is asked of the scheduler, because next() would begin a
    // cycle. The command itself opens the channel again.
    while (!is_stopping() && commands_.link_.bus.is_open()) {
      const PollScheduler::Job job = scheduler.next(Clock::now());
      if (job.kind == PollScheduler::Job::Kind::poll) {
        const Raised polling(commands_.polling_);
        if (!co_await run_poll(job.poll)) break;
      } else if (commands_.may_go_between()) {
        for (WaitingCommand& running : commands_.running_)
          running.credit -= commands_.waiting_.front().line_time;
        co_await commands_.run_next();
      } else {
        break;
      }
    }
    scheduler.share().command_taken();
  }
  void was_silent(nanoseconds lasted) override {
    commands_.link_.scheduler.was_silent(command_.device->id, lasted,
                                         PolledDevice::AskedBy::command);
  }
  asio::awaitable<bool> give_way_after_silence() override {
    bool has_run = false;
    while (!is_stopping() && commands_.link_.bus.is_open()) {
      const auto poll = commands_.link_.scheduler.next_after_silence(Clock::now());
      if (!poll || !co_await run_poll(*poll)) break;
      has_run = true;
    }
    co_return has_run;
  }

  void written_together(const Exchange& exchange) override {
    for (const AdmittedTarget& target : command_.admitted.targets)
      commands_.poller_.overwritten(*command_.device, *span_of(target.point),
                                    exchange.is_ack() ? &target.image : nullptr,
                                    bad_reason(exchange));
  }

  void concluded(std::size_t target, const TargetResult& outcome) override {
    const AdmittedCommand& admitted = command_.admitted;
    command_.credit += admitted.targets[target].line_time - std::exchange(within_, {});
    at_a_target_ = true;
    commands_.after_write(*command_.device, admitted.targets[target], outcome);
  }

  Reason why_stopping() const override {
    if (command_.device->leaves_by) return Reason::reloading;
    if (commands_.state_.is_stopping()) return commands_.state_.why_stopping();
    if (command_.admitted.interrupted) return Reason::none;
    met_conflict_ = met_conflict_ || commands_.link_.outbox.is_in_conflict();
    return met_conflict_ ? Reason::conflict : Reason::none;
  }
  bool may_send() const override {
    const auto& leaves_by = command_.device->leaves_by;
    return !commands_.over_ && (!leaves_by || Clock::now() < *leaves_by);
  }

 private:
  /// False: it sent nothing.
  asio::awaitable<bool> run_poll(PollScheduler::PollStep step) {
    const std::uint64_t before = commands_.link_.bus.counters().exchanges;
    co_await commands_.poller_.run(step);
    co_return commands_.link_.bus.counters().exchanges != before;
  }

  LinkCommands& commands_;
  WaitingCommand& command_;
  nanoseconds within_{0};  ///< line time used by the current target
  bool at_a_target_ = false;
  /// Kept, because the conflict may end between two targets.
  mutable bool met_conflict_ = false;
};

bool LinkCommands::may_go_between() const {
  if (waiting_.empty()) return false;
  const WaitingCommand& next = waiting_.front();
  return std::none_of(running_.begin(), running_.end(), [&next](const WaitingCommand& under_way) {
    if (next.line_time > under_way.credit) return true;
    if (next.device != under_way.device) return false;
    // A STOP must not wait. A RUN may be meant to follow the current writes. Places that are read
    // or written twice keep their sequence.
    if (next.admitted.run_request) return next.admitted.command.op != Op::stop;
    for (const AdmittedTarget& target : next.admitted.targets) {
      const Span span = *span_of(target.point);
      for (const AdmittedTarget& other : under_way.admitted.targets)
        if (overlap(span, *span_of(other.point))) return true;
    }
    return false;
  });
}

asio::awaitable<void> LinkCommands::run_next() {
  if (link_.outbox.is_in_conflict()) refuse_waiting(Reason::conflict);
  if (waiting_.empty()) co_return;
  running_.push_back(std::move(waiting_.front()));
  waiting_.pop_front();
  link_.scheduler.share().command_taken();
  WaitingCommand& running = running_.back();
  const AdmittedCommand& admitted = running.admitted;
  LinkDevice& device = *running.device;

  Station station = device.station;
  station.codec = admitted.codec;
  FrameTrace trace;
  station.trace = &trace;
  Sharing sharing(*this, running);
  CommandExecution execution(executor_, link_.bus, station, device.config, running.read_limits,
                             admitted, sharing);
  CommandResult result = co_await execution.run();
  failpoint("command_answered");
  // RUN and STOP may be a force, too. No older value of M8037 is reported after it was sent.
  if (const auto* force =
          admitted.run_request ? std::get_if<Force>(&*admitted.run_request) : nullptr;
      force != nullptr && result.attempts > 0)
    poller_.overwritten(device, {force->space, force->bit, 1}, nullptr, BadReason::timeout);

  device.station.handshake_in = station.handshake_in;
  state_.opened();
  link_.scheduler.command_used(execution.exchanges().used(), Clock::now());
  if (execution.exchanges().was_answered()) state_.answered(device);
  if (execution.exchanges().was_unanswered() && !execution.exchanges().was_answered())
    state_.unanswered(device, PolledDevice::AskedBy::command);
  result.bound = admitted.bound;
  if (admitted.run_request && result.status == CommandStatus::succeeded)
    device.state.set_run(admitted.command.op == Op::run);
  result.frames = std::move(trace);
  // The bound does not cover an opening.
  const bool met_opening = link_.bus.channel().open_ended() > admitted.queued;
  recorder_.ended(result, device.config.name, met_opening ? std::nullopt : result.bound);
  link_.outbox.push(std::move(result));
  running_.pop_back();
  // stop() closes the bus of a command that takes too long. That is no loss.
  if (state_.is_stopping() && !link_.bus.is_open()) co_return;
  state_.check_bus();
  state_.update(device);
}

void LinkCommands::after_write(LinkDevice& device, const AdmittedTarget& target,
                               const TargetResult& outcome) {
  if (target.requests.empty() || without_effect(outcome)) return;
  // After a string of odd length, the device has kept the byte behind it, so its memory may differ
  // from the image.
  const bool as_meant = outcome.status == CommandStatus::succeeded &&
                        (!outcome.verify || outcome.verify->match) && !has_padding(target.point);
  poller_.overwritten(device, *span_of(target.point), as_meant ? &target.image : nullptr,
                      bad_after(outcome.reason));
  if (!target.tag_index) return;
  const bool read_back = outcome.verify && outcome.verify->read;
  const bool whole = outcome.status == CommandStatus::succeeded;
  const bool in_part = outcome.status == CommandStatus::partial && read_back;
  if (!whole && !in_part) return;
  Value value = read_back ? *outcome.verify->read : target.written.value_or(Value());
  poller_.publish_written(device, *target.tag_index, std::move(value),
                          read_back ? Poller::Origin::read_back : Poller::Origin::written);
}

}  // namespace fxagent
