#include "agent/field/link/link_worker.h"

#include <algorithm>
#include <utility>

#include "agent/commands/result.h"
#include "agent/field/transport/stream_io.h"
#include "agent/log/log.h"

namespace fxagent {
namespace {

using std::chrono::milliseconds;
using Clock = std::chrono::steady_clock;

// A silent device that is alone on its line delays no other; on a shared line it costs the others
// its timeout.
constexpr BackOff kAlone{milliseconds(500), milliseconds(4000)};
constexpr BackOff kShared{milliseconds(1000), milliseconds(30000)};
// Pause after a bug before the link begins anew, so that the log stays readable.
constexpr milliseconds kAfterFault{1000};
// Shortest window of busy_percent: health may be asked for at any moment, and a moment shows
// nothing.
constexpr milliseconds kBusyOver{4500};
// First polls are spread over 1 s, or over the shortest interval if that is less.
constexpr milliseconds kSpread{1000};

/// Returns the device with this index in Config::devices; null: it is not on the link.
LinkDevice* device_of(const LinkDevices& devices, std::uint32_t index) {
  const auto found =
      std::ranges::find(devices, index, [](const auto& device) { return device->index; });
  return found == devices.end() ? nullptr : found->get();
}

void set_back_offs(PollScheduler& scheduler, const LinkDevices& devices) {
  const BackOff back_off = devices.size() > 1 ? kShared : kAlone;
  for (const auto& device : devices) scheduler.device(device->id).set_back_off(back_off);
}

}  // namespace

std::vector<std::vector<std::uint32_t>> devices_by_link(const Config& config) {
  std::vector<std::vector<std::uint32_t>> out(config.links.size());
  for (std::uint32_t i = 0; i < config.devices.size(); ++i)
    if (!config.devices[i].is_vacant()) out[config.devices[i].link].push_back(i);
  return out;
}

LinkWorker::LinkWorker(asio::any_io_executor executor, const Config& config, std::uint32_t link,
                       std::span<const std::uint32_t> devices, Outbox& outbox,
                       std::unique_ptr<Transport> transport,
                       std::span<const std::uint64_t> last_seq, Polling polling,
                       FlightRecorder* recorder)
    : config_(config.links[link]),
      polling_(polling),
      bus_(executor, std::move(transport), config_.char_time, config_.listening),
      recorder_(recorder, config_,
                config.recorder ? ring_bytes(*config.recorder, config.links.size()) : 0),
      scheduler_(config_.poll_share),
      parts_{config_, link, bus_, scheduler_, devices_, outbox},
      state_(parts_, config.links.size()),
      poller_(parts_, state_),
      commands_(executor, parts_, state_, poller_, recorder_),
      idle_(executor),
      counting_since_(Clock::now()) {
  trace(false);
  if (config.http) bus_.counters().durations = std::make_unique<LinkDurations>();
  milliseconds spread = kSpread;
  for (const std::uint32_t device : devices)
    for (const GroupConfig& group : config.devices[device].groups)
      if (group.interval.count() > 0) spread = std::min(spread, group.interval);
  polls_begun_ = state_.begin(Clock::now(), spread);
  for (const std::uint32_t device : devices) begin_polls(add_device(config, device, last_seq));
  set_back_offs(scheduler_, devices_);
}

void LinkWorker::number_above(std::uint32_t index, std::uint64_t seq) {
  if (LinkDevice* device = device_of(devices_, index)) device->seq = std::max(device->seq, seq);
}

void LinkWorker::submit(AdmittedCommand admitted) {
  LinkDevice* device = device_of(devices_, admitted.command.device);
  if (device == nullptr) return parts_.outbox.push(not_sent(admitted, Reason::reloading));
  if (state_.is_stopping()) return parts_.outbox.push(not_sent(admitted, state_.why_stopping()));
  if (device->leaves_by) return parts_.outbox.push(not_sent(admitted, Reason::reloading));
  if (yields_until_) return parts_.outbox.push(not_sent(admitted, Reason::yielded));
  commands_.add(std::move(admitted), *device);
  idle_.cancel();
}

LinkDevice& LinkWorker::add_device(const Config& config, std::uint32_t index,
                                   std::span<const std::uint64_t> last_seq) {
  auto device = std::make_unique<LinkDevice>(config.devices.shared(index), index);
  device->station.wiring = wiring_of(config_, device->config);
  device->station.recorded_as = recorder_.number(device->config);
  device->id = scheduler_.add_device(device->config.retries + 1, {});
  if (index < last_seq.size()) device->seq = last_seq[index];
  DeviceStatus status = device->state.reported();
  status.codec = device->codec;
  parts_.outbox.push(std::move(status));
  return *devices_.emplace_back(std::move(device));
}

/// Begins the polls of a device after those of the devices before it.
void LinkWorker::begin_polls(LinkDevice& device) {
  if (polling_ == Polling::on) polls_begun_ += poller_.add_groups(device, polls_begun_);
  if (polling_ == Polling::on || device.codec->plc() != nullptr) poller_.add_question(device);
}

// ---- a changed config ---------------------------------------------------------------------------

void LinkWorker::add(const Config& config, std::span<const std::uint32_t> devices,
                     std::span<const std::uint64_t> last_seq) {
  for (const std::uint32_t index : devices) {
    LinkDevice& device = add_device(config, index, last_seq);
    begin_polls(device);
    state_.update(device);
  }
  set_back_offs(scheduler_, devices_);
  idle_.cancel();
}

void LinkWorker::remove(std::span<const std::uint32_t> devices,
                        std::function<void(LinkDevices)> left) {
  for (const std::uint32_t index : devices) {
    LinkDevice* device = device_of(devices_, index);
    if (device == nullptr) continue;
    device->leaves_by = Clock::now() + kFinishWithin;
    commands_.refuse_waiting(Reason::reloading, device);
  }
  leaves_.push_back({{devices.begin(), devices.end()}, std::move(left)});
  if (!on_the_wire_) let_leave();
}

void LinkWorker::let_leave() {
  for (const Leave& leave : std::exchange(leaves_, {})) {
    LinkDevices gone;
    for (const std::uint32_t index : leave.devices) {
      const auto found =
          std::ranges::find(devices_, index, [](const auto& device) { return device->index; });
      if (found == devices_.end()) continue;
      scheduler_.remove_device((*found)->id);
      gone.push_back(std::move(*found));
      devices_.erase(found);
    }
    set_back_offs(scheduler_, devices_);
    leave.left(std::move(gone));
  }
}

void LinkWorker::adjust(const LinkConfig& link) {
  scheduler_.share().set_poll_share(link.poll_share);
  bus_.set_listening(link.listening);
  // `resume` is refused without allow_yield.
  if (yields_until_ && !link.allow_yield) take_back([](Reason) {});
}

void LinkWorker::adjust(std::uint32_t index, const DeviceConfig& next) {
  LinkDevice* device = device_of(devices_, index);
  if (device == nullptr) return;
  poller_.adjust_groups(*device, next.groups);
  idle_.cancel();
}

// ---- the loop -----------------------------------------------------------------------------------

asio::awaitable<void> LinkWorker::run() {
  while (!state_.is_stopping()) {
    try {
      co_await serve();
      continue;
    } catch (const std::exception& error) {  // a bug: the link begins anew
      log::error("link", {{"link", config_.name}, {"fault", error.what()}});
      bus_.close();
      commands_.answer_running();
    }
    if (!state_.is_stopping()) co_await wait_until(idle_, Clock::now() + kAfterFault);
  }
  bus_.close();
  stop_timer_.reset();
  commands_.refuse_waiting(state_.why_stopping());
  answer_yields(state_.why_stopping());
  let_leave();
  ended_ = true;
}

asio::awaitable<void> LinkWorker::serve() {
  while (!state_.is_stopping()) {
    let_leave();
    if (yields_until_) {
      co_await be_away();
      continue;
    }
    state_.check_bus();
    bus_log_.log_news();
    recorder_.check_link(bus_.counters().bad_frames, state_.is_up(), state_.why_down());
    const auto now = Clock::now();
    if (!bus_.is_open() && now >= state_.next_open()) {
      co_await open_line();
      continue;
    }
    const PollScheduler::Job job = scheduler_.next(now);
    if (job.kind == PollScheduler::Job::Kind::wait) {
      co_await wait_until(idle_,
                          bus_.is_open() ? job.until : std::min(job.until, state_.next_open()));
      continue;
    }
    const Raised on_the_wire(on_the_wire_);
    if (job.kind == PollScheduler::Job::Kind::command)
      co_await commands_.run_next();
    else
      co_await poller_.run(job.poll);
  }
}

void LinkWorker::yield(SteadyTime until, std::string text, Done done) {
  if (state_.is_stopping()) return done(state_.why_stopping());
  yields_until_ = until;
  yield_text_ = std::move(text);
  yields_done_.push_back(std::move(done));
  commands_.refuse_waiting(Reason::yielded);
  idle_.cancel();
}

void LinkWorker::take_back(Done done) {
  if (state_.is_stopping()) return done(state_.why_stopping());
  if (yields_until_) yields_until_ = SteadyTime{};
  yields_done_.push_back(std::move(done));
  idle_.cancel();
  if (!yields_until_) answer_yields(Reason::none);
}

asio::awaitable<void> LinkWorker::be_away() {
  if (Clock::now() < *yields_until_) {
    bus_.close();
    if (state_.is_stopping()) co_return;
    state_.yielded(yield_text_);
    answer_yields(Reason::none);
    co_await wait_until(idle_, *yields_until_);
    co_return;
  }
  yields_until_.reset();
  state_.taken_back();
  answer_yields(Reason::none);
  co_await open_line();
  scheduler_.forget_until(Clock::now());
}

void LinkWorker::answer_yields(Reason why) {
  for (const Done& done : std::exchange(yields_done_, {})) done(why);
}

void LinkWorker::stop(Reason why) {
  if (state_.is_stopping()) return;
  state_.stop(why);
  idle_.cancel();
  if (!commands_.is_running() || commands_.is_polling()) bus_.close();
  stop_timer_ = std::make_unique<asio::steady_timer>(idle_.get_executor(), kFinishWithin);
  stop_timer_->async_wait([this](const asio::error_code& cancelled) {
    if (cancelled) return;
    commands_.end();
    bus_.close();
  });
}

asio::awaitable<void> LinkWorker::open_line() {
  const auto opened = co_await bus_.open();
  if (state_.is_stopping()) co_return;  // stop() has closed it
  if (opened)
    state_.opened();
  else
    state_.open_failed(opened.error().text);
}

void LinkWorker::trace(bool on) {
  if (!on && recorder_.ring() == nullptr) return bus_.trace_to(nullptr);
  bus_.trace_to(std::make_unique<WireTrace>(
      config_.name, on ? WireTrace::Log::yes : WireTrace::Log::no, recorder_.ring()));
}

void LinkWorker::report(FieldHealth& health) {
  const auto now = Clock::now();
  Wire::Counters& counters = bus_.counters();
  LinkHealth& link = health.links[parts_.index];
  static_cast<BusCounters&>(link) = counters;
  link.open = bus_.is_open();
  link.yielded = state_.is_yielded();
  link.doubts = bus_.doubt().doubts();
  link.doubted = bus_.doubt().is_doubted();
  const double elapsed = std::chrono::duration<double>(now - counting_since_).count();
  const double busy = std::chrono::duration<double>(counters.busy).count();
  link.busy_percent = busy_percent_.value_or(elapsed > 0 ? 100.0 * busy / elapsed : 0);
  if (now - counting_since_ >= kBusyOver) {
    busy_percent_ = link.busy_percent = 100.0 * busy / elapsed;
    counters.busy = {};
    counting_since_ = now;
  }
  link.load_percent = 100.0 * scheduler_.load();
  link.turnaround_ms = counters.turnaround_ms.percentiles();
  if (counters.durations) health.durations[parts_.index] = *counters.durations;
  for (const auto& device : devices_) {
    DeviceHealth& out = health.devices[device->index];
    out.polls = scheduler_.device(device->id).counters().polls;
    out.missed = scheduler_.device(device->id).counters().missed;
    out.late_ms = device->late_ms.percentiles();
    out.collected = device->collected;
    out.suppressed = device->suppressed;
    out.reached.assign(device->config.groups.size(), {});
    for (const auto& group : device->groups)
      out.reached[group->cycle.group()] =
          std::chrono::duration_cast<milliseconds>(scheduler_.group(group->id).reached());
  }
}

}  // namespace fxagent
