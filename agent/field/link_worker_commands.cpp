// Commands of a link until they wait for the wire: admission, go-ahead, and what is never sent.
#include <algorithm>
#include <utility>

#include "agent/field/command_line_time.h"
#include "agent/field/link_worker.h"

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
  commands_.add(std::move(waiting));
  idle_.cancel();
}

CommandResult LinkWorker::unsent(const AdmittedCommand& admitted, CommandStatus status) {
  CommandResult result = result_of(admitted.command);
  if (admitted.interrupted)
    set_outcome(result, CommandStatus::unknown_outcome, Reason::none, std::string(kInterrupted));
  else
    set_outcome(result, status, Reason::shutting_down, "the agent is stopping; nothing was sent");
  return result;
}

}  // namespace fxagent
