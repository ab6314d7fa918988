// Commands of a link: from their admission to their result, and what they mean for the polls.
#include <algorithm>
#include <utility>

#include "agent/failpoint.h"
#include "agent/field/command_execution.h"
#include "agent/field/command_line_time.h"
#include "agent/field/link_worker.h"
#include "agent/line_time.h"
#include "agent/log/log.h"
#include "protocol/plc.h"

namespace fxagent {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;
using Clock = std::chrono::steady_clock;

AdmissionNote note_of(const AdmittedCommand& admitted) {
  const Command& command = admitted.command;
  AdmissionNote note;
  note.device = command.device;
  note.number = command.number;
  note.id = command.id;
  note.op = command.op_text;
  note.received_ms = command.received_ms;
  note.deadline_ms = command.received_ms +
                     std::chrono::ceil<milliseconds>(admitted.deadline - command.received).count();
  note.response_topic = command.response_topic;
  note.correlation = command.correlation;
  return note;
}

bool overlap(const Span& one, const Span& other) {
  return one.space == other.space && one.first_bit < other.end_bit() &&
         other.first_bit < one.end_bit();
}

}  // namespace

void LinkWorker::submit(Command command) {
  Device* device = device_of(command.device);
  if (device == nullptr) return;
  const auto now = Clock::now();
  auto decision = device->admission.admit(std::move(command), *device->codec, device->waiting, now);
  if (auto* result = std::get_if<CommandResult>(&decision)) {
    outbox_.push(std::move(*result));
    return;
  }
  if (state_.is_stopping()) {
    CommandResult result = unsent(std::get<AdmittedCommand>(decision), CommandStatus::rejected);
    device->admission.finished(result);
    outbox_.push(std::move(result));
    return;
  }
  Waiting waiting;
  waiting.admitted = std::move(std::get<AdmittedCommand>(decision));
  waiting.device = device;
  waiting.codec = device->codec;
  take_line_times(waiting);
  ++device->waiting;
  if (journaling_ == Journaling::off) return enqueue(std::move(waiting));
  outbox_.push(note_of(waiting.admitted));
  unjournaled_.push_back(std::move(waiting));
}

void LinkWorker::take_line_times(Waiting& waiting) const {
  const nanoseconds char_time = config_.links[link_].char_time;
  waiting.line_time =
      line_time_of(*waiting.codec, waiting.device->config, char_time, waiting.admitted);
  set_line_times(*waiting.codec, waiting.device->config, char_time, waiting.admitted);
}

void LinkWorker::take_interrupted(Command command) {
  Device* device = device_of(command.device);
  if (device == nullptr) return;
  Waiting waiting;
  waiting.device = device;
  waiting.codec = device->codec;
  auto admitted = device->admission.interrupted(command, *device->codec, Clock::now());
  if (!admitted) {
    waiting.admitted.command = std::move(command);
    waiting.admitted.interrupted = true;
    CommandResult result = unsent(waiting.admitted, CommandStatus::unknown_outcome);
    device->admission.finished(result);
    outbox_.push(std::move(result));
    return;
  }
  waiting.admitted = std::move(*admitted);
  take_line_times(waiting);
  ++device->waiting;
  enqueue(std::move(waiting));
}

void LinkWorker::go_ahead(std::uint32_t device, const std::string& id) {
  const auto found =
      std::find_if(unjournaled_.begin(), unjournaled_.end(), [&](const Waiting& waiting) {
        return waiting.device->index == device && waiting.admitted.command.id == id;
      });
  if (found == unjournaled_.end()) return;  // answered already: the agent is stopping
  Waiting waiting = std::move(*found);
  unjournaled_.erase(found);
  waiting.admitted.go_ahead = Clock::now();
  enqueue(std::move(waiting));
}

void LinkWorker::enqueue(Waiting waiting) {
  waiting.admitted.bound = bound_of(waiting);
  waiting_.push_back(std::move(waiting));
  scheduler_.command_waits();
  idle_.cancel();
}

nanoseconds LinkWorker::handshakes() const {
  nanoseconds total{0};
  for (const auto& device : devices_) {
    const auto enquiry = device->codec->resync();
    if (!enquiry || device->config.enquire != EnquirePolicy::open) continue;
    if (bus_.is_open() && device->station.handshake_in == bus_.session()) continue;
    const LineTiming timing = timing_of(device->config, config_.links[link_].char_time);
    total += exchange_time(*device->codec, *enquiry, timing);
  }
  return total;
}

std::optional<nanoseconds> LinkWorker::bound_of(const Waiting& command) const {
  if (config_.links[link_].char_time.count() == 0) return std::nullopt;
  nanoseconds ahead{0};
  for (const Waiting& running : running_) ahead += running.line_time;
  for (const Waiting& waiting : waiting_) ahead += waiting.line_time;
  const nanoseconds own = command.line_time;
  return handshakes() + (gives_way(command.admitted)
                             ? scheduler_.bound_giving_way(own, ahead, poller_.longest_poll())
                             : scheduler_.bound(own, ahead, poller_.longest_poll()));
}

CommandResult LinkWorker::unsent(const AdmittedCommand& admitted, CommandStatus status) {
  CommandResult result = result_of(admitted.command);
  if (admitted.interrupted)
    set_outcome(result, CommandStatus::unknown_outcome, Reason::none, std::string(kInterrupted));
  else
    set_outcome(result, status, Reason::shutting_down, "the agent is stopping; nothing was sent");
  return result;
}

// ---- on the wire --------------------------------------------------------------------------------

/// One command's dealings with the polls and with the commands that wait behind it.
class LinkWorker::Sharing final : public BusSharing {
 public:
  Sharing(LinkWorker& worker, const Waiting& command)
      : worker_(worker), command_(command), outer_(worker.sharing_) {
    worker.sharing_ = this;
  }
  Sharing(const Sharing&) = delete;
  Sharing& operator=(const Sharing&) = delete;
  ~Sharing() override { worker_.sharing_ = outer_; }

  /// The polls have their share as between commands. Commands that wait have as much line time as
  /// this one has had, in their order: a short one goes after the first target, one as long as
  /// this one waits for its end. So nobody is put off for longer than his bound says.
  asio::awaitable<void> give_way(nanoseconds used) override {
    if (!at_a_target_) within_ += used;
    at_a_target_ = false;
    PollScheduler& scheduler = worker_.scheduler_;
    scheduler.command_waits();  // the rest of this one
    scheduler.command_used(used, Clock::now());
    while (!worker_.state_.is_stopping()) {
      const PollScheduler::Job job = scheduler.next(Clock::now());
      if (job.kind == PollScheduler::Job::Kind::poll) {
        const bool on_the_line = co_await worker_.poll_between(job.poll);
        if (!on_the_line) break;
      } else if (worker_.may_go_between(credit())) {
        give(worker_.waiting_.front().line_time);
        co_await worker_.run_command();
      } else {
        break;
      }
    }
    scheduler.command_taken();
  }

  void concluded(std::size_t target, const TargetResult& outcome) override {
    const AdmittedCommand& admitted = command_.admitted;
    if (target >= admitted.targets.size()) return;
    had_ += admitted.targets[target].line_time;
    within_ = {};
    at_a_target_ = true;
    worker_.after_write(*command_.device, admitted.targets[target], outcome);
  }

  bool is_stopping() const override { return worker_.state_.is_stopping(); }
  bool is_over() const override { return worker_.over_; }

 private:
  /// Line time that others may have now: what this command has had and not yet given, and the one
  /// that it went between itself.
  nanoseconds credit() const {
    const nanoseconds own = had_ + within_ - given_;
    return outer_ == nullptr ? own : std::min(own, outer_->credit());
  }
  void give(nanoseconds line_time) {
    for (Sharing* each = this; each != nullptr; each = each->outer_) each->given_ += line_time;
  }

  LinkWorker& worker_;
  const Waiting& command_;
  Sharing* const outer_;  ///< of the command that rests while this one is under way
  // Planned line time, which is what the bound of a command is made of.
  nanoseconds had_{0};     ///< by the targets that have their outcome
  nanoseconds within_{0};  ///< by the one that has not
  nanoseconds given_{0};   ///< to other commands
  bool at_a_target_ = false;
};

bool LinkWorker::may_go_between(nanoseconds credit) const {
  if (waiting_.empty() || waiting_.front().line_time > credit) return false;
  const Waiting& next = waiting_.front();
  return std::none_of(running_.begin(), running_.end(), [&next](const Waiting& under_way) {
    if (next.device != under_way.device) return false;
    // A STOP may not wait; a RUN may be meant to come after what is being written. And what is
    // read or written twice is meant in its order.
    if (next.admitted.run_request) return next.admitted.command.op != Op::stop;
    for (const AdmittedTarget& target : next.admitted.targets) {
      const Span span = *span_of(target.point);
      for (const AdmittedTarget& other : under_way.admitted.targets)
        if (overlap(span, *span_of(other.point))) return true;
    }
    return false;
  });
}

asio::awaitable<bool> LinkWorker::poll_between(PollScheduler::PollStep step) {
  // Where the line is down a poll would not take any of it: the command opens it again.
  if (!bus_.is_open()) co_return false;
  const std::uint64_t before = bus_.counters().exchanges;
  co_await poller_.run(step);
  co_return bus_.counters().exchanges != before;
}

asio::awaitable<void> LinkWorker::run_command() {
  running_.push_back(std::move(waiting_.front()));
  waiting_.pop_front();
  scheduler_.command_taken();
  const Waiting& running = running_.back();
  const AdmittedCommand& admitted = running.admitted;
  Device& device = *running.device;
  --device.waiting;

  Station station = device.station;
  station.codec = running.codec.get();
  FrameTrace trace;
  station.trace = &trace;
  Sharing sharing(*this, running);
  CommandExecution execution(executor_, bus_, station, device.config, admitted, &sharing);
  CommandResult result = co_await execution.run();
  failpoint("order_answered");

  device.station.handshake_in = station.handshake_in;
  state_.opened();
  scheduler_.command_used(execution.used(), Clock::now());
  if (execution.was_answered()) state_.answered(device);
  if (execution.was_unanswered() && !execution.was_answered()) state_.unanswered(device);
  result.bound = admitted.bound;
  device.admission.finished(result);
  if (admitted.run_request && result.status == CommandStatus::succeeded)
    device.state.set_run(admitted.command.op == Op::run);
  result.frames = std::move(trace);
  outbox_.push(std::move(result));
  running_.pop_back();
  state_.update(device);
}

void LinkWorker::after_write(Device& device, const AdmittedTarget& target,
                             const TargetResult& outcome) {
  if (!target.tag_index || target.requests.empty()) return;
  const bool read_back = outcome.verify && outcome.verify->read;
  const bool whole = outcome.status == CommandStatus::succeeded;
  const bool in_part = outcome.status == CommandStatus::partial && read_back;
  if (!whole && !in_part) return;
  Value value = read_back ? *outcome.verify->read : target.written.value_or(Value());
  poller_.publish_written(device, *target.tag_index, std::move(value),
                          read_back ? Poller::Origin::read_back : Poller::Origin::written);
}

}  // namespace fxagent
