#include "agent/field/link_worker.h"

#include <algorithm>
#include <utility>

#include "agent/field/link_device.h"
#include "agent/field/stream_io.h"
#include "agent/line_time.h"
#include "agent/log/log.h"

namespace fxagent {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;
using Clock = std::chrono::steady_clock;

// Opening a serial path costs nothing; a host that is away should not be hammered, nor one that has
// just come back by all its clients at once.
constexpr ReconnectRules kSerialReconnects{milliseconds(500), milliseconds(2000), milliseconds(0)};
constexpr ReconnectRules kTcpReconnects{milliseconds(500), milliseconds(30000), milliseconds(200)};
// Alone on its line a silent device costs nobody anything; beside others it costs them its timeout.
constexpr BackOff kAlone{milliseconds(500), milliseconds(4000)};
constexpr BackOff kShared{milliseconds(1000), milliseconds(30000)};
// So many unanswered exchanges in a row on TCP, whoever was asked, mean that the peer is gone.
constexpr int kDeadPeerAfter = 3;
// The RUN state is asked for soon after its beat, however busy the groups keep the line.
constexpr milliseconds kRunStateWithin{2000};
// A link that fell over a bug rests before it begins anew, so that the log stays readable.
constexpr milliseconds kAfterFault{1000};
// What is on the wire when the agent is to stop has so long, and what is to be read back.
constexpr milliseconds kFinishWithin{2500};
// A bus that comes to be doubted again and again is told of so often; each time is counted.
constexpr std::chrono::seconds kDoubtToldEvery{60};
// First polls are spread over the first second, or over the interval where that is shorter.
constexpr milliseconds kSpread{1000};

/// Another one for each link, each start and each machine.
std::uint64_t jitter_seed(std::uint32_t link) {
  return static_cast<std::uint64_t>(std::chrono::system_clock::now().time_since_epoch().count()) +
         link;
}

ReconnectRules opening_rules(const LinkConfig& link) {
  return std::holds_alternative<SerialSettings>(link.channel) ? kSerialReconnects : kTcpReconnects;
}

}  // namespace

std::vector<std::vector<std::uint32_t>> devices_by_link(const Config& config) {
  std::vector<std::vector<std::uint32_t>> out(config.links.size());
  for (std::uint32_t i = 0; i < config.devices.size(); ++i)
    out[config.devices[i].link].push_back(i);
  return out;
}

LinkWorker::LinkWorker(asio::any_io_executor executor, const Config& config, std::uint32_t link,
                       std::span<const std::uint32_t> devices, Outbox& outbox,
                       std::unique_ptr<Transport> transport, const RestoredState& restored,
                       Polling polling, Journaling journaling, std::shared_ptr<CommandRoom> room)
    : executor_(executor),
      config_(config),
      link_(link),
      outbox_(outbox),
      bus_(executor, std::move(transport), config.links[link].char_time),
      scheduler_(config.links[link].poll_share),
      idle_(executor),
      journaling_(journaling),
      room_(std::move(room)),
      reconnect_policy_(opening_rules(config.links[link]), jitter_seed(link)),
      counting_since_(Clock::now()),
      stop_timer_(executor) {
  const auto now = Clock::now();
  milliseconds spread = kSpread;
  for (const std::uint32_t device : devices)
    for (const GroupConfig& group : config.devices[device].groups)
      if (group.interval.count() > 0) spread = std::min(spread, group.interval);
  const LinkStart start = reconnect_policy_.start(config.links.size(), spread);
  next_open_ = now + start.open_after;
  first_poll_after_ = start.poll_after - start.open_after;
  const BackOff back_off = devices.size() > 1 ? kShared : kAlone;
  for (const std::uint32_t device : devices) {
    add_device(device, back_off, polling);
    if (device < restored.last_seq.size()) devices_.back()->seq = restored.last_seq[device];
  }
}

LinkWorker::~LinkWorker() = default;

void LinkWorker::number_above(std::uint32_t index, std::uint64_t seq) {
  if (Device* device = device_of(index)) device->seq = std::max(device->seq, seq);
}

void LinkWorker::remember(const RememberedId& remembered) {
  if (Device* device = device_of(remembered.device))
    device->admission.restore(remembered, Clock::now(), now_ms());
}

void LinkWorker::add_device(std::uint32_t index, BackOff back_off, Polling polling) {
  const DeviceConfig& config = config_.devices[index];
  auto device = std::make_unique<Device>(config, index, journaling_, room_);
  device->id = scheduler_.add_device(config.retries + 1, back_off);
  for (std::uint32_t g = 0; polling == Polling::on && g < config.groups.size(); ++g) {
    auto group = std::make_unique<GroupPoll>(config, g);
    if (group->cycle.tags().empty()) continue;
    // Each group begins when those before it should be through, and meets them there again and
    // again where the intervals are multiples of each other.
    const milliseconds interval = std::max(config.groups[g].interval, milliseconds(1));
    group->id = scheduler_.add_group(device->id, config.groups[g].interval, 1,
                                     next_open_ + first_poll_after_ % nanoseconds(interval));
    make_plan(*device, *group);
    first_poll_after_ += group->cycle.plan().line_time;
    device->groups.push_back(std::move(group));
  }
  if (device->codec->plc() != nullptr)
    device->run_state_group =
        scheduler_.add_group(device->id, kRunStateInterval, 1, next_open_, kRunStateWithin);
  outbox_.push(device->state.told());
  by_index_[index] = device.get();
  devices_.push_back(std::move(device));
}

LinkWorker::Device* LinkWorker::device_of(std::uint32_t index) {
  const auto found = by_index_.find(index);
  return found == by_index_.end() ? nullptr : found->second;
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
  bus_.close();
  stop_timer_.cancel();
  waiting_.splice(waiting_.end(), unjournaled_);
  for (const Waiting& waiting : waiting_)
    outbox_.push(unsent(waiting.admitted, CommandStatus::failed));
  waiting_.clear();
  ended_ = true;
}

void LinkWorker::answer_after_fault(const std::string& what) {
  log::error("link", {{"link", config_.links[link_].name}, {"fault", what}});
  bus_.close();
  polling_ = false;
  scheduler_.commands_are(static_cast<std::uint32_t>(waiting_.size()));
  for (const Waiting& running : running_) {
    CommandResult result = result_of(running.admitted.command);
    set_outcome(result, CommandStatus::unknown_outcome, Reason::link_down,
                "a fault in the agent ended the link while the command was under way");
    running.device->admission.finished(result);
    outbox_.push(std::move(result));
  }
  running_.clear();
}

asio::awaitable<void> LinkWorker::serve() {
  while (!stopping_) {
    if (!bus_.is_open() && was_open_) line_lost(std::string(bus_.why_lost()));
    if (bus_.echo_found() && !echo_told_) {
      echo_told_ = true;
      log::warn("link", {{"link", config_.links[link_].name},
                         {"echo", "found"},
                         {"note",
                          "set echo for its devices: before three reads have shown it, the "
                          "echo of a command may look like its answer"}});
    }
    tell_doubt();
    const auto now = Clock::now();
    if (!bus_.is_open() && now >= next_open_) {
      co_await open_line();
      continue;
    }
    const PollScheduler::Job job = scheduler_.next(now);
    switch (job.kind) {
      case PollScheduler::Job::Kind::command:
        co_await run_command();
        break;
      case PollScheduler::Job::Kind::poll:
        polling_ = true;
        co_await run_step(job.poll);
        polling_ = false;
        break;
      case PollScheduler::Job::Kind::wait:
        co_await idle_until(bus_.is_open() ? job.until : std::min(job.until, next_open_));
        break;
    }
  }
}

void LinkWorker::tell_doubt() {
  const std::string& name = config_.links[link_].name;
  if (!unexpected_told_ && !bus_.last_unexpected().empty()) {
    unexpected_told_ = true;
    log::warn("link", {{"link", name},
                       {"unexpected", bus_.last_unexpected()},
                       {"note", "bytes that nobody asked for; health counts them from here on"}});
  }
  const bool doubted = bus_.doubt().is_doubted();
  if (doubted == doubt_told_) return;
  const auto now = Clock::now();
  if (doubted && doubt_told_at_ && now - *doubt_told_at_ < kDoubtToldEvery) return;
  doubt_told_ = doubted;
  if (doubted) {
    doubt_told_at_ = now;
    log::warn("link", {{"link", name},
                       {"state", "doubted"},
                       {"unexpected", bus_.last_unexpected()},
                       {"note",
                        "another master, or answers that come late? values are bad_frame, and no "
                        "ACK is believed until some exchanges in a row were clean"}});
  } else {
    log::info("link", {{"link", name}, {"state", "believed again"}});
  }
}

void LinkWorker::stop() {
  stopping_ = true;
  idle_.cancel();
  if (running_.empty() || polling_) bus_.close();
  stop_timer_.expires_after(kFinishWithin);
  stop_timer_.async_wait([this](const asio::error_code& cancelled) {
    if (cancelled) return;
    over_ = true;
    bus_.close();
  });
}

asio::awaitable<void> LinkWorker::idle_until(SteadyTime until) {
  idle_.expires_at(until);
  co_await idle_.async_wait(use_result);
}

asio::awaitable<void> LinkWorker::open_line() {
  const auto opened = co_await bus_.open();
  const auto now = Clock::now();
  if (opened) {
    line_up();
    co_return;
  }
  next_open_ = now + reconnect_policy_.after_failure();
  line_lost(opened.error().text);
}

void LinkWorker::line_up() {
  // A peer that babbles takes every connection: it is back when it has answered.
  if (!bus_.never_silent()) reconnect_policy_.opened();
  was_open_ = true;
  unanswered_in_a_row_ = 0;
  log::info("link", {{"link", config_.links[link_].name}, {"state", "up"}});
}

void LinkWorker::line_lost(const std::string& why) {
  if (was_open_)
    next_open_ = Clock::now() + (bus_.never_silent() ? reconnect_policy_.after_failure()
                                                     : reconnect_policy_.after_loss());
  if (was_open_ || why != why_down_)
    log::warn("link", {{"link", config_.links[link_].name}, {"state", "down"}, {"reason", why}});
  was_open_ = false;
  why_down_ = why;
  for (const auto& device : devices_) update_status(*device);
}

// ---- states -------------------------------------------------------------------------------------

void LinkWorker::note_answer(Device& device) {
  unanswered_in_a_row_ = 0;
  if (!bus_.never_silent()) reconnect_policy_.opened();
  device.state.answered();
  scheduler_.device_answered(device.id);
}

void LinkWorker::note_unreachable(Device& device) {
  unanswered_in_a_row_ = 0;
  scheduler_.device_unanswered(device.id, Clock::now());
}

void LinkWorker::note_silence(Device& device) {
  const bool silent = scheduler_.device_unanswered(device.id, Clock::now());
  if (silent) device.state.fell_silent();
  const bool tcp = std::holds_alternative<TcpSettings>(config_.links[link_].channel);
  const int limit = std::max(kDeadPeerAfter, static_cast<int>(devices_.size()) + 1);
  if (tcp && ++unanswered_in_a_row_ >= limit) {
    bus_.close();
    line_lost("nobody answers on this connection");
  }
}

void LinkWorker::update_status(Device& device) {
  DeviceState::Facts facts;
  facts.bus_open = bus_.is_open();
  facts.never_silent = bus_.never_silent();
  facts.silent = scheduler_.is_silent(device.id);
  for (const auto& group : device.groups) {
    facts.first_bad = group->cycle.first_bad();
    if (facts.first_bad) break;
  }
  const auto change = device.state.update(facts, now_ms());
  if (!change) return;
  if (change->other_state)
    log::info("device", {{"device", device.config.name},
                         {"state", std::string(to_string(change->status.state))},
                         {"reason", change->status.reason}});
  outbox_.push(change->status);
}

void LinkWorker::report(FieldHealth& health) {
  const auto now = Clock::now();
  Bus::Counters& counters = bus_.counters();
  LinkHealth& link = health.links[link_];
  link.exchanges = counters.exchanges;
  link.timeouts = counters.timeouts;
  link.naks = counters.naks;
  link.bad_frames = counters.bad_frames;
  link.unexpected_bytes = counters.unexpected_bytes;
  link.doubts = bus_.doubt().doubts();
  link.doubted = bus_.doubt().is_doubted();
  const double elapsed = std::chrono::duration<double>(now - counting_since_).count();
  const double busy = std::chrono::duration<double>(counters.busy).count();
  link.load_percent = 100.0 * scheduler_.load();
  link.busy_percent = elapsed > 0 ? 100.0 * busy / elapsed : 0;
  counters.busy = {};
  counting_since_ = now;
  link.turnaround_ms = counters.turnaround_ms.percentiles();
  for (const auto& device : devices_) {
    DeviceHealth& out = health.devices[device->index];
    out.polls = scheduler_.counters(device->id).polls;
    out.missed = scheduler_.counters(device->id).missed;
    out.late_ms = device->late_ms.percentiles();
    out.collected = device->collected;
    out.suppressed = device->suppressed;
  }
}

}  // namespace fxagent
