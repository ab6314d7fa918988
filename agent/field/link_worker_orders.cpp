// Commands of a link: from their admission to their result, and what they mean for the polls.
#include <algorithm>
#include <utility>

#include "agent/fault_point.h"
#include "agent/field/link_device.h"
#include "agent/field/order_run.h"
#include "agent/line_time.h"
#include "agent/log.h"

namespace fxagent {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;
using Clock = std::chrono::steady_clock;

OrderNote note_of(const Order& order) {
  const Command& command = order.command;
  OrderNote note;
  note.device = command.device;
  note.arrival = command.arrival;
  note.id = command.id;
  note.op = command.op_text;
  note.received_ms = command.received_ms;
  note.deadline_ms = command.received_ms +
                     std::chrono::ceil<milliseconds>(order.deadline - command.received).count();
  note.response_topic = command.response_topic;
  note.correlation = command.correlation;
  return note;
}

}  // namespace

void LinkWorker::submit(Command command) {
  Device* device = device_of(command.device);
  if (device == nullptr) return;
  const auto now = Clock::now();
  auto verdict = device->desk.admit(std::move(command), *device->codec, device->waiting, now);
  if (auto* result = std::get_if<CommandResult>(&verdict)) {
    outbox_.push(std::move(*result));
    return;
  }
  if (stopping_) {
    CommandResult result = unsent(std::get<Order>(verdict));
    device->desk.finished(result);
    outbox_.push(std::move(result));
    return;
  }
  Waiting waiting;
  waiting.order = std::move(std::get<Order>(verdict));
  waiting.device = device;
  waiting.codec = device->codec;
  waiting.line_time = OrderRun::line_time(*device->codec, device->config,
                                          config_.links[link_].char_time, waiting.order);
  ++device->waiting;
  if (journaling_ == Journaling::off) return enqueue(std::move(waiting));
  outbox_.push(note_of(waiting.order));
  unjournaled_.push_back(std::move(waiting));
}

void LinkWorker::take_left_behind(Command command) {
  Device* device = device_of(command.device);
  if (device == nullptr) return;
  Waiting waiting;
  waiting.device = device;
  waiting.codec = device->codec;
  auto order = device->desk.left_behind(command, *device->codec, Clock::now());
  if (!order) {
    waiting.order.command = std::move(command);
    waiting.order.left_behind = true;
    CommandResult result = unsent(waiting.order);
    device->desk.finished(result);
    outbox_.push(std::move(result));
    return;
  }
  waiting.order = std::move(*order);
  waiting.line_time = OrderRun::line_time(*device->codec, device->config,
                                          config_.links[link_].char_time, waiting.order);
  ++device->waiting;
  enqueue(std::move(waiting));
}

void LinkWorker::go_ahead(std::uint32_t device, const std::string& id) {
  const auto found =
      std::find_if(unjournaled_.begin(), unjournaled_.end(), [&](const Waiting& waiting) {
        return waiting.device->index == device && waiting.order.command.id == id;
      });
  if (found == unjournaled_.end()) return;  // answered already: the agent is stopping
  Waiting waiting = std::move(*found);
  unjournaled_.erase(found);
  waiting.order.go_ahead = Clock::now();
  enqueue(std::move(waiting));
}

void LinkWorker::enqueue(Waiting waiting) {
  waiting.order.bound = bound_of(waiting.line_time);
  waiting_.push_back(std::move(waiting));
  agenda_.command_waits();
  idle_.cancel();
}

nanoseconds LinkWorker::longest_poll() const {
  nanoseconds longest{0};
  for (const auto& device : devices_) {
    const LineTiming timing = timing_of(device->config, config_.links[link_].char_time);
    std::vector<const Plan*> plans;
    for (const auto& group : device->groups) plans.push_back(&group->plan);
    nanoseconds of_device = fxagent::longest_poll(*device->codec, plans, timing);
    if (!device->model_known)  // the questions about the model go as one with the read they precede
      for (const Request& question : device->config.codec->identify())
        of_device += exchange_time(*device->codec, question, timing);
    longest = std::max(longest, of_device);
  }
  return longest;
}

nanoseconds LinkWorker::greetings() const {
  nanoseconds total{0};
  for (const auto& device : devices_) {
    const auto enquiry = device->codec->resync();
    if (!enquiry || device->config.enquire != EnquirePolicy::open) continue;
    if (line_.is_open() && device->station.greeted_in == line_.session()) continue;
    const LineTiming timing = timing_of(device->config, config_.links[link_].char_time);
    total += exchange_time(*device->codec, *enquiry, timing);
  }
  return total;
}

std::optional<nanoseconds> LinkWorker::bound_of(nanoseconds own) const {
  if (config_.links[link_].char_time.count() == 0) return std::nullopt;
  nanoseconds ahead = running_ ? running_->line_time : nanoseconds(0);
  for (const Waiting& waiting : waiting_) ahead += waiting.line_time;
  return greetings() + agenda_.bound(own, ahead, longest_poll());
}

CommandResult LinkWorker::unsent(const Order& order) {
  CommandResult result = result_of(order.command);
  if (order.left_behind) {
    result.status = CommandStatus::unknown_outcome;
    result.detail = kLeftBehind;
  } else {
    result.status = CommandStatus::rejected;
    result.reason = Reason::shutting_down;
    result.detail = "the agent is stopping; nothing was sent";
  }
  return result;
}

asio::awaitable<void> LinkWorker::run_command() {
  running_ = std::move(waiting_.front());
  waiting_.pop_front();
  agenda_.command_taken();
  const Order& order = running_->order;
  Device& device = *running_->device;
  --device.waiting;

  Station station = device.station;
  station.codec = running_->codec.get();
  FrameTrace trace;
  station.trace = &trace;
  OrderRun order_run(executor_, line_, station, device.config, order);
  CommandResult result = co_await order_run.run();
  fault_point("order_answered");

  device.station.greeted_in = station.greeted_in;
  if (line_.is_open() && !was_open_) line_up();
  agenda_.command_used(result.wire, Clock::now());
  if (order_run.was_answered()) note_answer(device);
  if (order_run.was_unanswered() && !order_run.was_answered()) note_silence(device);
  result.bound = order.bound;
  device.desk.finished(result);
  after_write(device, result, order);
  if (order.run_order && result.status == CommandStatus::succeeded)
    device.run = order.command.op == Op::run;
  result.frames = std::move(trace);
  outbox_.push(std::move(result));
  running_.reset();
  update_status(device);
}

void LinkWorker::after_write(Device& device, const CommandResult& result, const Order& order) {
  for (std::size_t i = 0; i < order.targets.size(); ++i) {
    const OrderTarget& target = order.targets[i];
    const TargetResult& outcome = result.targets[i];
    if (!target.tag_index || target.requests.empty()) continue;
    if (outcome.status != CommandStatus::succeeded) continue;
    const bool read_back = outcome.verify && outcome.verify->read;
    const Value value = read_back ? *outcome.verify->read : target.written.value_or(Value());
    const TagConfig& tag = device.config.tags[*target.tag_index];
    for (const auto& group : device.groups) {
      if (group->group != tag.group) continue;
      group->newer[*target.tag_index] = value;
      Telemetry message;
      message.ts_ms = now_ms();
      message.partial = true;
      message.written = !read_back;
      message.readings.push_back(group->report.written(*target.tag_index, value, message.ts_ms));
      ++device.collected;
      publish(device, tag.group, std::move(message));
    }
  }
}

}  // namespace fxagent
