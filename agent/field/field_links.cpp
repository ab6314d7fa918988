#include "agent/field/field_links.h"

#include <algorithm>
#include <asio/co_spawn.hpp>
#include <asio/post.hpp>
#include <exception>
#include <utility>
#include <variant>

#include "agent/commands/result.h"
#include "agent/field/transport/host_lookup.h"
#include "agent/field/transport/transport.h"
#include "agent/handover/field_health.h"
#include "agent/log/log.h"

namespace fxagent {
namespace {

/// Logs a bug that ended one link's coroutine. The other links go on.
void report_end(const std::exception_ptr& bug, const std::string& link) {
  if (!bug) return;
  try {
    std::rethrow_exception(bug);
  } catch (const std::exception& e) {
    log::error("link", {{"link", link}, {"state", "ended"}, {"bug", e.what()}});
  }
}

}  // namespace

FieldLinks::FieldLinks(asio::io_context& io, const Config& config, Outbox& outbox,
                       const std::vector<std::uint64_t>& last_seq, Polling polling,
                       FlightRecorder* recorder, const LinePermit* permit)
    : config_(std::make_shared<const Config>(config)),
      outbox_(outbox),
      polling_(polling),
      recorder_(recorder),
      permit_(permit),
      io_(io) {
  const auto devices = devices_by_link(*config_);
  places_.resize(config_->links.size());
  for (std::uint32_t i = 0; i < config_->links.size(); ++i)
    if (!config_->links[i].is_vacant()) make_worker(i, devices[i], last_seq);
}

void FieldLinks::start() {
  for (std::uint32_t i = 0; i < places_.size(); ++i)
    if (places_[i].worker) spawn(i);
}

void FieldLinks::stop(Done over) {
  over_ = std::move(over);
  stopping_ = true;
  for (const Place& place : places_)
    if (place.worker) place.worker->stop();
  leave_if_over();
}

void FieldLinks::leave_if_over() {
  if (stopping_ && running_ == 0) over_();
}

std::string FieldLinks::unfinished() const {
  constexpr int kNamed = 3;
  const std::lock_guard lock(places_mutex_);
  std::string names;
  int count = 0;
  for (const Place& place : places_)
    if (place.worker && !place.worker->has_ended() && ++count <= kNamed)
      names += (names.empty() ? "" : " ") + place.name;
  if (count > kNamed) names += " and " + std::to_string(count - kNamed) + " more";
  return names;
}

void FieldLinks::make_worker(std::uint32_t link, const std::vector<std::uint32_t>& devices,
                             const std::vector<std::uint64_t>& last_seq) {
  auto worker = std::make_unique<LinkWorker>(
      io_.get_executor(), *config_, link, devices, outbox_,
      make_transport(io_.get_executor(), config_->links[link], permit_), last_seq, polling_,
      recorder_);
  const std::string& name = config_->links[link].name;
  if (traces_all_ || traced_.contains(name)) worker->trace(true);
  const std::lock_guard lock(places_mutex_);
  places_[link].name = name;
  places_[link].worker = std::move(worker);
}

void FieldLinks::spawn(std::uint32_t link) {
  const bool looks_up = !std::holds_alternative<SerialSettings>(config_->links[link].channel);
  if (looks_up && !looks_up_) start_looking_up(io_.get_executor());
  looks_up_ = looks_up_ || looks_up;
  places_[link].runs = true;
  ++running_;
  asio::co_spawn(io_, places_[link].worker->run(), [this, link](std::exception_ptr bug) {
    report_end(bug, places_[link].name);
    places_[link].runs = false;
    --running_;
    // The coroutine's frame may still exist, so the worker is destroyed later.
    if (places_[link].ends) asio::post(io_, [this, link] { link_left(link); });
    leave_if_over();
  });
}

LinkWorker* FieldLinks::worker_of(const DeviceConfig& device) {
  return device.is_vacant() ? nullptr : places_[device.link].worker.get();
}

void FieldLinks::take(AdmittedCommand admitted) {
  const std::uint32_t device = admitted.command.device;
  begin_for(device);
  LinkWorker* worker =
      device < config_->devices.size() ? worker_of(config_->devices[device]) : nullptr;
  if (worker == nullptr) return outbox_.push(not_sent(admitted, Reason::reloading));
  worker->submit(std::move(admitted));
}

void FieldLinks::yield(const std::string& link, std::chrono::minutes time, const std::string& text,
                       LinkWorker::Done done) {
  const auto place = std::ranges::find_if(places_, [&](const Place& each) {
    return each.worker && !each.ends && each.runs && each.name == link;
  });
  if (place == places_.end()) return done(stopping_ ? Reason::shutting_down : Reason::reloading);
  if (time.count() == 0) return place->worker->take_back(std::move(done));
  place->worker->yield(std::chrono::steady_clock::now() + time, text, std::move(done));
}

void FieldLinks::number_above(const std::vector<std::uint64_t>& last_seq) {
  for (std::uint32_t i = 0; i < last_seq.size() && i < config_->devices.size(); ++i) {
    const DeviceConfig& device = config_->devices[i];
    std::uint64_t& known = last_numbers_[device.name];
    known = std::max(known, last_seq[i]);
    if (LinkWorker* worker = worker_of(device)) worker->number_above(i, last_seq[i]);
  }
}

void FieldLinks::trace(const std::vector<std::uint32_t>& links) {
  for (const std::uint32_t link : links) {
    traced_.insert(config_->links[link].name);
    places_.at(link).worker->trace(true);
  }
}

void FieldLinks::switch_traces() {
  traces_all_ = std::ranges::none_of(
      places_, [](const Place& place) { return place.worker && place.worker->is_traced(); });
  traced_.clear();
  for (const Place& place : places_)
    if (place.worker) place.worker->trace(traces_all_);
  log::info("trace", {{"links", "all"}, {"state", traces_all_ ? "on" : "off"}});
}

void FieldLinks::report() {
  FieldHealth health;
  health.links.resize(config_->links.size());
  health.devices.resize(config_->devices.size());
  if (config_->http) health.durations.resize(config_->links.size());
  for (const Place& place : places_)
    if (place.worker) place.worker->report(health);
  health.ended_collected = ended_collected_;
  health.ended_suppressed = ended_suppressed_;
  outbox_.push(std::move(health));
}

// ---- a changed config ---------------------------------------------------------------------------

void FieldLinks::end(const std::shared_ptr<const ConfigChange>& next, Done done) {
  if (stopping_) return;
  const ConfigChange& change = *next;
  end_done_ = std::move(done);
  still_to_leave_ = 1;
  std::vector<std::vector<std::uint32_t>> leaving(places_.size());
  for (const std::uint32_t device : change.devices_end)
    leaving[config_->devices[device].link].push_back(device);
  for (const std::uint32_t link : change.links_end) {
    leaving[link].clear();
    places_[link].has_failed = false;
    if (!places_[link].worker) continue;
    ++still_to_leave_;
    places_[link].ends = true;
    places_[link].worker->stop(Reason::reloading);
    if (!places_[link].runs) link_left(link);
  }
  for (std::uint32_t link = 0; link < leaving.size(); ++link) {
    if (leaving[link].empty() || !places_[link].worker) continue;
    ++still_to_leave_;
    places_[link].worker->remove(leaving[link], [this](const auto& gone) { left(gone); });
  }
  left({});
}

void FieldLinks::link_left(std::uint32_t link) {
  if (stopping_) return;  // stop() still collects its counters
  std::unique_lock lock(places_mutex_);
  const Place ended = std::exchange(places_[link], {});
  lock.unlock();
  left(ended.worker->devices());
}

void FieldLinks::left(const LinkDevices& gone) {
  for (const auto& device : gone) {
    last_numbers_[device->config.name] = device->seq;
    ended_collected_ += device->collected;
    ended_suppressed_ += device->suppressed;
  }
  if (--still_to_leave_ > 0 || stopping_) return;
  report();
  std::exchange(end_done_, {})();
}

void FieldLinks::begin(const std::shared_ptr<const ConfigChange>& next,
                       std::vector<std::uint64_t> last_seq, Done done) {
  if (stopping_) return;
  const ConfigChange& change = *next;
  config_ = {next, &change.config};
  {
    const std::lock_guard lock(places_mutex_);
    places_.resize(config_->links.size());
  }
  for (const std::uint32_t link : change.links_adjusted)
    if (places_[link].worker) places_[link].worker->adjust(config_->links[link]);
  for (const std::uint32_t device : change.devices_adjusted)
    if (LinkWorker* worker = worker_of(config_->devices[device]))
      worker->adjust(device, config_->devices[device]);
  last_seq_ = std::move(last_seq);
  last_seq_.resize(config_->devices.size());
  std::vector<std::vector<std::uint32_t>> joining(places_.size());
  for (const std::uint32_t device : change.devices_begin)
    joining[config_->devices[device].link].push_back(device);
  for (const std::uint32_t link : change.links_begin)
    if (joining[link].empty()) to_begin_.push_back({link, {}});
  for (std::uint32_t link = 0; link < joining.size(); ++link)
    for (const std::uint32_t device : joining[link]) to_begin_.push_back({link, {device}});
  begin_done_ = std::move(done);
  begin_next();
}

void FieldLinks::begin_next() {
  if (stopping_) return to_begin_.clear();
  if (to_begin_.empty()) return std::exchange(begin_done_, {})();
  begin_one(to_begin_.begin());
  asio::post(io_, [this] { begin_next(); });
}

void FieldLinks::begin_one(std::deque<ToBegin>::iterator which) {
  const ToBegin next = std::move(*which);
  to_begin_.erase(which);
  // Its other devices did not begin: they would stay `starting` for good.
  if (places_[next.link].has_failed) return;
  // If the name has ended in this run, or a store has reported it since, go on from that number.
  for (const std::uint32_t device : next.devices) {
    const auto known = last_numbers_.find(config_->devices[device].name);
    if (known != last_numbers_.end()) last_seq_[device] = known->second;
  }
  try {
    if (LinkWorker* worker = places_[next.link].worker.get())
      return worker->add(*config_, next.devices, last_seq_);
    make_worker(next.link, next.devices, last_seq_);
    spawn(next.link);
  } catch (const std::exception& error) {  // no thread for name lookups, or no memory
    log::error("link",
               {{"link", config_->links[next.link].name},
                {"state", "not begun"},
                {"reason", error.what()},
                {"note", "the agent refuses commands for this link until the agent is restarted"}});
    if (places_[next.link].runs) return;
    places_[next.link].has_failed = true;
    const std::lock_guard lock(places_mutex_);
    places_[next.link].worker.reset();
  }
}

void FieldLinks::begin_for(std::uint32_t device) {
  const auto which = std::ranges::find(to_begin_, std::vector{device}, &ToBegin::devices);
  if (which != to_begin_.end() && !stopping_) begin_one(which);
}

}  // namespace fxagent
