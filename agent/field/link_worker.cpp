#include "agent/field/link_worker.h"

#include <algorithm>
#include <iterator>
#include <utility>

#include "agent/fault_point.h"
#include "agent/field/order_run.h"
#include "agent/field/stream_io.h"
#include "agent/line_time.h"
#include "agent/log.h"

namespace fxagent {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;
using Clock = std::chrono::steady_clock;

// Opening a serial path costs nothing; a host that is away should not be hammered, nor one that has
// just come back by all its clients at once.
constexpr OpeningRules kSerialOpenings{milliseconds(500), milliseconds(2000), milliseconds(0)};
constexpr OpeningRules kTcpOpenings{milliseconds(500), milliseconds(30000), milliseconds(200)};
// Alone on its line a silent device costs nobody anything; beside others it costs them its timeout.
constexpr BackOff kAlone{milliseconds(500), milliseconds(4000)};
constexpr BackOff kShared{milliseconds(1000), milliseconds(30000)};
// So many unanswered exchanges in a row on TCP, whoever was asked, mean that the peer is gone.
constexpr int kDeadPeerAfter = 3;
// How long a group without an interval rests where no way of its device's model reaches its tags.
constexpr milliseconds kNothingToRead{1000};
// A group without an interval that is faster than the broker looks again so soon.
constexpr std::chrono::microseconds kUplinkRest{500};
// The RUN state is asked for soon after its beat, however busy the groups keep the line.
constexpr milliseconds kRunStateWithin{2000};
// A device's own time is taken from so many exchanges, and a plan made for another one is made anew
// where the two differ by this factor and by more than the scheduling of a busy machine.
constexpr std::uint32_t kTurnaroundsKnown = 64;
constexpr double kOtherTurnaround = 1.5;
constexpr milliseconds kTurnaroundNoise{3};
// An overload is over when the line has a little to spare, so that the log stays quiet at the edge.
constexpr double kOverloadOver = 0.95;
// A device that says it is busy is asked again once it may have finished.
constexpr milliseconds kBusyPause{100};
// A link that fell over a bug rests before it begins anew, so that the log stays readable.
constexpr milliseconds kAfterFault{1000};
// First polls are spread over the first second, or over the interval where that is shorter.
constexpr milliseconds kSpread{1000};

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

/// Another one for each link, each start and each machine.
std::uint64_t jitter_seed(std::uint32_t link) {
  return static_cast<std::uint64_t>(std::chrono::system_clock::now().time_since_epoch().count()) +
         link;
}

OpeningRules opening_rules(const LinkConfig& link) {
  return std::holds_alternative<SerialSettings>(link.channel) ? kSerialOpenings : kTcpOpenings;
}

std::int64_t now_ms() { return utc_ms(std::chrono::system_clock::now()); }

}  // namespace

/// One group of one device and the cycle it is in.
struct LinkWorker::GroupPoll {
  GroupPoll(const DeviceConfig& device, std::uint32_t index)
      : group(index), report(device, index) {}

  std::uint32_t group;
  GroupReport report;
  Agenda::GroupId id = 0;
  Plan plan;                          ///< its points are report.tags(), in order
  std::uint32_t holes_version = 0;    ///< HoleMap::version() that the plan was made under
  nanoseconds planned_turnaround{0};  ///< the device's own time that it was made with

  // The running cycle.
  std::vector<Bytes> images;                       ///< beside plan.reads
  std::vector<std::optional<BadReason>> failures;  ///< beside plan.reads
  std::unordered_map<std::uint32_t, Value> newer;  ///< tag → what a command has written meanwhile
  std::optional<SteadyTime> first_reply;
  SteadyTime last_reply{};
  std::int64_t last_reply_ms = 0;
  std::uint32_t replies = 0;
  std::uint32_t next_read = 0;
  int repeats = 0;

  void begin() {
    images.assign(plan.reads.size(), {});
    failures.assign(plan.reads.size(), std::nullopt);
    newer.clear();
    first_reply.reset();
    last_reply_ms = 0;
    replies = 0;
    next_read = 0;
    repeats = 0;
  }
};

/// A device as this worker knows it: its codec of the moment, its plans, its state.
struct LinkWorker::Device {
  Device(const DeviceConfig& device_config, std::uint32_t device_index, Journaling journaling)
      : config(device_config),
        index(device_index),
        codec(device_config.codec),
        desk(config, journaling) {
    station.codec = codec.get();
    station.timeout = config.timeout;
    station.gap = config.gap;
    station.enquire = config.enquire;
    station.echo = config.echo;
    turnaround = config.turnaround;
    model_known = !codec->model().empty() || codec->identify().empty();
  }

  const DeviceConfig& config;
  const std::uint32_t index;
  std::shared_ptr<const Codec> codec;  ///< the config's, or that of the model found by asking
  Station station;
  CommandDesk desk;
  Agenda::DeviceId id = 0;
  HoleMap holes;
  nanoseconds turnaround{0};      ///< its own time: the config's, or as it was measured
  nanoseconds turnaround_sum{0};  ///< of the exchanges counted
  std::uint32_t turnarounds = 0;
  std::vector<std::unique_ptr<GroupPoll>> groups;
  std::optional<Agenda::GroupId> run_state_group;
  bool model_known = false;
  bool model_unclear = false;  ///< was asked, and the answers do not tell
  bool answered_once = false;
  std::optional<bool> run;
  std::uint64_t seq = 0;
  std::size_t waiting = 0;  ///< commands queued
  PercentileWindow late_ms;
  std::uint64_t collected = 0;
  std::uint64_t suppressed = 0;
  DeviceStatus status;
};

std::vector<std::vector<std::uint32_t>> devices_by_link(const Config& config) {
  std::vector<std::vector<std::uint32_t>> out(config.links.size());
  for (std::uint32_t i = 0; i < config.devices.size(); ++i)
    out[config.devices[i].link].push_back(i);
  return out;
}

LinkWorker::LinkWorker(asio::any_io_executor executor, const Config& config, std::uint32_t link,
                       std::span<const std::uint32_t> devices, Outbox& outbox,
                       std::unique_ptr<Transport> transport, const Recollection& recollection,
                       Polling polling, Journaling journaling)
    : executor_(executor),
      config_(config),
      link_(link),
      outbox_(outbox),
      line_(executor, std::move(transport), config.links[link].char_time),
      agenda_(config.links[link].poll_share),
      idle_(executor),
      journaling_(journaling),
      openings_(opening_rules(config.links[link]), jitter_seed(link)),
      counting_since_(Clock::now()) {
  const auto now = Clock::now();
  milliseconds spread = kSpread;
  for (const std::uint32_t device : devices)
    for (const GroupConfig& group : config.devices[device].groups)
      if (group.interval.count() > 0) spread = std::min(spread, group.interval);
  const LinkStart start = openings_.start(config.links.size(), spread);
  next_open_ = now + start.open_after;
  first_poll_after_ = start.poll_after - start.open_after;
  const BackOff back_off = devices.size() > 1 ? kShared : kAlone;
  for (const std::uint32_t device : devices) {
    add_device(device, back_off, polling);
    if (device < recollection.last_seq.size()) devices_.back()->seq = recollection.last_seq[device];
  }
}

LinkWorker::~LinkWorker() = default;

void LinkWorker::number_above(std::uint32_t index, std::uint64_t seq) {
  if (Device* device = device_of(index)) device->seq = std::max(device->seq, seq);
}

void LinkWorker::remember(const RememberedId& remembered) {
  if (Device* device = device_of(remembered.device))
    device->desk.restore(remembered, Clock::now(), now_ms());
}

void LinkWorker::add_device(std::uint32_t index, BackOff back_off, Polling polling) {
  const DeviceConfig& config = config_.devices[index];
  auto device = std::make_unique<Device>(config, index, journaling_);
  device->id = agenda_.add_device(config.retries + 1, back_off);
  for (std::uint32_t g = 0; polling == Polling::on && g < config.groups.size(); ++g) {
    auto group = std::make_unique<GroupPoll>(config, g);
    if (group->report.tags().empty()) continue;
    // Each group begins when those before it should be through, and meets them there again and
    // again where the intervals are multiples of each other.
    const milliseconds interval = std::max(config.groups[g].interval, milliseconds(1));
    group->id = agenda_.add_group(device->id, config.groups[g].interval, 1,
                                  next_open_ + first_poll_after_ % nanoseconds(interval));
    make_plan(*device, *group);
    first_poll_after_ += group->plan.line_time;
    device->groups.push_back(std::move(group));
  }
  if (device->codec->run_state())
    device->run_state_group =
        agenda_.add_group(device->id, kRunStateBeat, 1, next_open_, kRunStateWithin);
  device->status.device = index;
  device->status.since_ms = now_ms();
  device->status.reason = "starting";
  device->status.model = device->codec->model();
  outbox_.push(device->status);
  by_index_[index] = device.get();
  devices_.push_back(std::move(device));
}

LinkWorker::Device* LinkWorker::device_of(std::uint32_t index) {
  const auto found = by_index_.find(index);
  return found == by_index_.end() ? nullptr : found->second;
}

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
  group.begin();
  agenda_.set_exchanges(group.id, static_cast<std::uint32_t>(group.plan.reads.size()));
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

// ---- the loop -----------------------------------------------------------------------------------

asio::awaitable<void> LinkWorker::run() {
  while (!stopping_) {
    std::string fault;
    try {
      co_await serve();
    } catch (const std::exception& error) {
      fault = error.what();
    }
    if (fault.empty()) continue;
    answer_after_fault(fault);
    if (!stopping_) co_await idle_until(Clock::now() + kAfterFault);
  }
  line_.close();
  waiting_.splice(waiting_.end(), unjournaled_);
  for (const Waiting& waiting : waiting_) outbox_.push(unsent(waiting.order));
  waiting_.clear();
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

void LinkWorker::answer_after_fault(const std::string& what) {
  log::error("link", {{"link", config_.links[link_].name}, {"fault", what}});
  line_.close();
  if (!running_) return;
  CommandResult result = result_of(running_->order.command);
  result.status = CommandStatus::unknown_outcome;
  result.reason = Reason::link_down;
  result.detail = "a fault in the agent ended the link while the order was under way";
  running_->device->desk.finished(result);
  outbox_.push(std::move(result));
  running_.reset();
}

asio::awaitable<void> LinkWorker::serve() {
  while (!stopping_) {
    if (!line_.is_open() && was_open_) line_lost("the line was lost");
    if (line_.echo_found() && !echo_told_) {
      echo_told_ = true;
      log::warn("link", {{"link", config_.links[link_].name},
                         {"echo", "found"},
                         {"note",
                          "set echo for its devices: until three reads have told, an "
                          "order's echo may look like its answer"}});
    }
    const auto now = Clock::now();
    if (!line_.is_open() && now >= next_open_) {
      co_await open_line();
      continue;
    }
    const Agenda::Job job = agenda_.next(now);
    switch (job.kind) {
      case Agenda::Job::Kind::command:
        co_await run_command();
        break;
      case Agenda::Job::Kind::poll:
        co_await run_step(job.poll);
        break;
      case Agenda::Job::Kind::wait:
        co_await idle_until(line_.is_open() ? job.until : std::min(job.until, next_open_));
        break;
    }
  }
}

void LinkWorker::stop() {
  stopping_ = true;
  idle_.cancel();
  if (!running_) line_.close();
}

asio::awaitable<void> LinkWorker::idle_until(SteadyTime until) {
  idle_.expires_at(until);
  co_await idle_.async_wait(use_result);
}

asio::awaitable<void> LinkWorker::open_line() {
  const auto opened = co_await line_.open();
  const auto now = Clock::now();
  if (opened) {
    line_up();
    co_return;
  }
  next_open_ = now + openings_.after_failure();
  line_lost(opened.error().text);
}

void LinkWorker::line_up() {
  openings_.opened();
  was_open_ = true;
  unanswered_in_a_row_ = 0;
  log::info("link", {{"link", config_.links[link_].name}, {"state", "up"}});
}

void LinkWorker::line_lost(const std::string& why) {
  if (was_open_) next_open_ = Clock::now() + openings_.after_loss();
  if (was_open_ || why != why_down_)
    log::warn("link", {{"link", config_.links[link_].name}, {"state", "down"}, {"reason", why}});
  was_open_ = false;
  why_down_ = why;
  for (const auto& device : devices_) update_status(*device);
}

// ---- commands -----------------------------------------------------------------------------------

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

// ---- polls --------------------------------------------------------------------------------------

asio::awaitable<void> LinkWorker::run_step(Agenda::PollStep step) {
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
          agenda_.abandon_cycle(group->id, Clock::now() + kUplinkRest);
          co_return;
        }
        refresh_plan(*device, *group);
        group->begin();
        device->late_ms.add(step.late);
      }
      if (!line_.is_open()) {
        fail_cycle(*device, *group, BadReason::link_down);
        co_return;
      }
      BadReason failure = BadReason::timeout;
      const Knowledge knowledge = co_await know_model(*device, failure);
      if (knowledge == Knowledge::unanswered) fail_cycle(*device, *group, failure);
      if (knowledge != Knowledge::known) co_return;  // under a new plan the cycle is offered again
      if (group->plan.reads.empty()) {
        agenda_.abandon_cycle(group->id, Clock::now() + kNothingToRead);
        finish_cycle(*device, *group);
        co_return;
      }
      const Read read = group->plan.reads[step.exchange].read;
      Exchange exchange = co_await line_.exchange(device->station, read);
      take_reading(*device, *group, step, std::move(exchange));
      co_return;
    }
  }
}

void LinkWorker::take_reading(Device& device, GroupPoll& group, const Agenda::PollStep& step,
                              Exchange exchange) {
  if (stopping_) return;
  agenda_.step_used(step, exchange.ended - exchange.began);
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
  bool repeatable = exchange.outcome == Exchange::Outcome::garbled;
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
    ++group.repeats;  // the agenda offers the same step again, after the commands that wait
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
  if (!agenda_.step_done(step)) return;
  note_load();
  finish_cycle(device, group);
}

void LinkWorker::note_load() {
  const double load = agenda_.load();
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

bool LinkWorker::take_refusal(Device& device, GroupPoll& group, const Agenda::PollStep& step,
                              const Exchange& exchange, RefusalMeaning meaning) {
  note_answer(device);
  switch (meaning) {
    case RefusalMeaning::busy:
      agenda_.postpone(step, exchange.ended + kBusyPause);
      return true;
    case RefusalMeaning::hole: {
      const PlannedRead& planned = group.plan.reads[step.exchange];
      const auto halves = halves_of(*device.codec, points_of(device, group), planned);
      // Plans change between cycles only: this one goes on, and what it does bring is published.
      device.holes.refused(planned.read.span, halves, exchange.ended);
      if (!halves)
        log::warn("device", {{"device", device.config.name},
                             {"refused", device.codec->name_of(planned.read.span)},
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
  agenda_.abandon_cycle(group.id, line_.is_open() ? Clock::now() : next_open_);
  finish_cycle(device, group);
}

void LinkWorker::finish_cycle(Device& device, GroupPoll& group) {
  const auto& tags = group.report.tags();
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

asio::awaitable<void> LinkWorker::read_run_state(Device& device, Agenda::PollStep step) {
  Knowledge knowledge = Knowledge::unanswered;
  BadReason failure = BadReason::link_down;
  if (line_.is_open()) knowledge = co_await know_model(device, failure);
  const auto question = device.codec->run_state();
  if (knowledge != Knowledge::unanswered && line_.is_open() && question) {
    const Exchange exchange = co_await line_.exchange(device.station, *question);
    if (stopping_) co_return;
    agenda_.step_used(step, exchange.ended - exchange.began);
    if (exchange.has_answer()) note_answer(device);
    if (exchange.outcome == Exchange::Outcome::unanswered) note_silence(device);
    if (exchange.outcome == Exchange::Outcome::link_down) line_lost(exchange.error);
    device.run.reset();
    if (exchange.is_data()) device.run = device.codec->run_state_from(exchange.reply.image);
  }
  agenda_.step_done(step);
  update_status(device);
}

asio::awaitable<LinkWorker::Knowledge> LinkWorker::know_model(Device& device, BadReason& failure) {
  if (device.model_known) co_return Knowledge::known;
  const Codec& asking = *device.config.codec;
  const std::vector<Request> questions = asking.identify();
  std::vector<Bytes> images;
  for (const Request& question : questions) {
    const Exchange exchange = co_await line_.exchange(device.station, question);
    if (stopping_) co_return Knowledge::unanswered;
    agenda_.poll_used(exchange.ended - exchange.began);
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
  device.model_known = true;
  const auto model = asking.model_from(images);
  device.model_unclear = !model;
  if (!model) {
    log::warn("device", {{"device", device.config.name},
                         {"model", "unknown"},
                         {"note", "only what every model has is used; set model in the config"}});
  } else if (*model != device.codec->model()) {
    log::info("device", {{"device", device.config.name}, {"model", *model}});
  }
  const std::string now_known = model.value_or("");
  const bool changed = now_known != device.codec->model();
  if (changed) {
    device.codec = model ? asking.with_model(*model) : device.config.codec;
    device.station.codec = device.codec.get();
    device.status.model = now_known;
    for (const auto& group : device.groups) make_plan(device, *group);
  }
  update_status(device);
  co_return changed ? Knowledge::plan_changed : Knowledge::known;
}

// ---- states -------------------------------------------------------------------------------------

void LinkWorker::note_answer(Device& device) {
  unanswered_in_a_row_ = 0;
  device.answered_once = true;
  agenda_.device_answered(device.id);
}

void LinkWorker::note_unreachable(Device& device) {
  unanswered_in_a_row_ = 0;
  agenda_.device_unanswered(device.id, Clock::now());
}

void LinkWorker::note_silence(Device& device) {
  const bool silent = agenda_.device_unanswered(device.id, Clock::now());
  if (silent) {
    device.run.reset();
    // Whoever answers next may be another PLC.
    if (device.config.codec->model().empty() && !device.config.codec->identify().empty()) {
      device.model_known = false;
    }
  }
  const bool tcp = std::holds_alternative<TcpSettings>(config_.links[link_].channel);
  const int limit = std::max(kDeadPeerAfter, static_cast<int>(devices_.size()) + 1);
  if (tcp && ++unanswered_in_a_row_ >= limit) {
    line_.close();
    line_lost("nobody answers on this connection");
  }
}

void LinkWorker::update_status(Device& device) {
  DeviceStatus status = device.status;
  status.run = device.run;
  status.state = DeviceStatus::State::online;
  status.reason.clear();
  if (!line_.is_open()) {
    status.state = DeviceStatus::State::offline;
    status.reason = to_string(BadReason::link_down);
    status.run.reset();
  } else if (agenda_.is_silent(device.id)) {
    status.state = DeviceStatus::State::offline;
    status.reason = to_string(BadReason::timeout);
  } else if (!device.answered_once) {
    return;
  } else if (device.model_unclear) {
    status.state = DeviceStatus::State::degraded;
    status.reason = "model_unknown";
  } else {
    for (const auto& group : device.groups) {
      const auto bad = group->report.first_bad();
      if (!bad) continue;
      status.state = DeviceStatus::State::degraded;
      status.reason = to_string(*bad);
      break;
    }
  }
  DeviceStatus& old = device.status;
  const bool other_state = status.state != old.state;
  if (!other_state && status.reason == old.reason && status.model == old.model &&
      status.run == old.run && old.reason != "starting")
    return;
  if (other_state || old.reason == "starting") {
    status.since_ms = now_ms();
    log::info("device", {{"device", device.config.name},
                         {"state", std::string(to_string(status.state))},
                         {"reason", status.reason}});
  }
  old = status;
  outbox_.push(status);
}

void LinkWorker::report(FieldHealth& health) {
  const auto now = Clock::now();
  Line::Counters& line = line_.counters();
  LinkHealth& link = health.links[link_];
  link.exchanges = line.exchanges;
  link.timeouts = line.timeouts;
  link.naks = line.naks;
  link.bad_frames = line.bad_frames;
  const double elapsed = std::chrono::duration<double>(now - counting_since_).count();
  const double busy = std::chrono::duration<double>(line.busy).count();
  link.load_percent = 100.0 * agenda_.load();
  link.busy_percent = elapsed > 0 ? 100.0 * busy / elapsed : 0;
  line.busy = {};
  counting_since_ = now;
  link.turnaround_ms = line.turnaround_ms.percentiles();
  for (const auto& device : devices_) {
    DeviceHealth& out = health.devices[device->index];
    out.polls = agenda_.counters(device->id).polls;
    out.missed = agenda_.counters(device->id).missed;
    out.late_ms = device->late_ms.percentiles();
    out.collected = device->collected;
    out.suppressed = device->suppressed;
  }
}

}  // namespace fxagent
