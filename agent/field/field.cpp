#include "agent/field/field.h"

#include <algorithm>
#include <asio/co_spawn.hpp>
#include <asio/io_context.hpp>
#include <asio/post.hpp>
#include <asio/signal_set.hpp>
#include <asio/steady_timer.hpp>
#include <chrono>
#include <deque>
#include <exception>
#include <map>
#include <mutex>
#include <set>
#include <thread>
#include <utility>
#include <variant>

#include "agent/commands/result.h"
#include "agent/field/link/link_worker.h"
#include "agent/field/transport/host_lookup.h"
#include "agent/field/transport/transport.h"
#include "agent/handover/field_health.h"
#include "agent/log/log.h"
#include "agent/without_signals.h"

namespace fxagent {
namespace {

constexpr std::chrono::seconds kReportEvery{5};

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

/// The thread and the links that run on it, each with its worker. Begins and ends the links, also
/// in the middle of a run when the config changes, and hands commands to them. Its functions run on
/// the thread; before that starts and after it has ended, on the caller's.
class Field::Thread final {
 public:
  Thread(const Config& config, Outbox& to, const std::vector<std::uint64_t>& last_seq,
         Polling polling, FlightRecorder* recorder, const LinePermit* permit)
      : outbox(to),
        polling_(polling),
        recorder_(recorder),
        permit_(permit),
        report_timer_(io),
        config_(std::make_shared<const Config>(config)) {
    const auto devices = devices_by_link(*config_);
    places_.resize(config_->links.size());
    for (std::uint32_t i = 0; i < config_->links.size(); ++i)
      if (!config_->links[i].is_vacant()) make_worker(i, devices[i], last_seq);
  }

  /// Begins the loop of each link.
  void begin_loops() {
    for (std::uint32_t i = 0; i < places_.size(); ++i)
      if (places_[i].worker) spawn(i);
    report_later();
  }
  /// Ends all links as LinkWorker::stop(), then the thread, even if an abandoned name lookup is
  /// still running.
  void stop() {
    report_timer_.cancel();
    asio::error_code ignored;
    for (asio::signal_set& each : signals_) each.cancel(ignored);
    stopping_ = true;
    for (const Place& place : places_)
      if (place.worker) place.worker->stop();
    leave_if_over();
  }
  void call_at(int signal, const std::function<void()>& act) {
    await(signals_.emplace_back(io, signal), act);
  }

  std::string unfinished() const {
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

  void take(AdmittedCommand admitted) {
    const std::uint32_t device = admitted.command.device;
    begin_for(device);
    LinkWorker* worker =
        device < config_->devices.size() ? worker_of(config_->devices[device]) : nullptr;
    if (worker == nullptr) return outbox.push(not_sent(admitted, Reason::reloading));
    worker->submit(std::move(admitted));
  }

  void yield(const std::string& link, std::chrono::minutes time, const std::string& text,
             LinkWorker::Told told) {
    const auto place = std::ranges::find_if(places_, [&](const Place& each) {
      return each.worker && !each.ends && each.runs && each.name == link;
    });
    if (place == places_.end()) return told(stopping_ ? Reason::shutting_down : Reason::reloading);
    if (time.count() == 0) return place->worker->take_back(std::move(told));
    place->worker->yield(std::chrono::steady_clock::now() + time, text, std::move(told));
  }

  void number_above(const std::vector<std::uint64_t>& last_seq) {
    for (std::uint32_t i = 0; i < last_seq.size() && i < config_->devices.size(); ++i) {
      const DeviceConfig& device = config_->devices[i];
      std::uint64_t& known = last_numbers_[device.name];
      known = std::max(known, last_seq[i]);
      if (LinkWorker* worker = worker_of(device)) worker->number_above(i, last_seq[i]);
    }
  }

  void trace(const std::vector<std::uint32_t>& links) {
    for (const std::uint32_t link : links) {
      traced_.insert(config_->links[link].name);
      places_.at(link).worker->trace(true);
    }
  }

  void switch_traces() {
    traces_all_ = std::ranges::none_of(
        places_, [](const Place& place) { return place.worker && place.worker->is_traced(); });
    traced_.clear();
    for (const Place& place : places_)
      if (place.worker) place.worker->trace(traces_all_);
    log::info("trace", {{"links", "all"}, {"state", traces_all_ ? "on" : "off"}});
  }

  void report() {
    FieldHealth health;
    health.links.resize(config_->links.size());
    health.devices.resize(config_->devices.size());
    if (config_->http) health.durations.resize(config_->links.size());
    for (const Place& place : places_)
      if (place.worker) place.worker->report(health);
    health.ended_collected = ended_collected_;
    health.ended_suppressed = ended_suppressed_;
    outbox.push(std::move(health));
  }

  // ---- a changed config ------------------------------------------------------------------------

  void end(const ConfigChange& change, Done done) {
    if (stopping_) return;
    end_done_ = std::move(done);
    still_to_leave_ = 1;
    std::vector<std::vector<std::uint32_t>> leaving(places_.size());
    for (const std::uint32_t device : change.devices_end)
      leaving[config_->devices[device].link].push_back(device);
    for (const std::uint32_t link : change.links_end) {
      leaving[link].clear();
      if (!places_[link].worker) continue;
      ++still_to_leave_;
      places_[link].ends = true;
      places_[link].worker->stop(Reason::reloading);
      if (!places_[link].runs) link_left(link);
    }
    for (std::uint32_t link = 0; link < leaving.size(); ++link) {
      if (leaving[link].empty()) continue;
      ++still_to_leave_;
      places_[link].worker->remove(leaving[link], [this](const auto& gone) { left(gone); });
    }
    left({});
  }

  void begin(const std::shared_ptr<const ConfigChange>& next, std::vector<std::uint64_t> last_seq,
             Done done) {
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

  asio::io_context io{1};
  Outbox& outbox;
  std::thread thread;
  std::mutex over;
  bool is_over = false;  ///< under `over`: the thread has ended, and submit() answers at once

 private:
  /// A link, by index in Config::links.
  struct Place {
    std::string name;
    std::unique_ptr<LinkWorker> worker;  ///< null: vacant, or the link has ended
    bool runs = false;                   ///< its coroutine has not ended
    bool ends = false;                   ///< a changed config ends it
  };
  /// A device that a change adds and that has not begun, with its link if that is new; or a new
  /// link without devices. One entry begins per turn of the event loop, so that planning many
  /// devices does not delay the polls of others.
  struct ToBegin {
    std::uint32_t link = 0;
    std::vector<std::uint32_t> devices;  ///< one, or none
  };

  void report_later() {
    report_timer_.expires_after(kReportEvery);
    report_timer_.async_wait([this](const asio::error_code& error) {
      if (error || stopping_) return;
      report();
      report_later();
    });
  }
  /// Calls `act` at each of the signals, which must outlive the thread.
  static void await(asio::signal_set& signals, const std::function<void()>& act) {
    signals.async_wait([&signals, act](const asio::error_code& cancelled, int) {
      if (cancelled) return;
      act();
      await(signals, act);
    });
  }

  void make_worker(std::uint32_t link, const std::vector<std::uint32_t>& devices,
                   const std::vector<std::uint64_t>& last_seq) {
    auto worker = std::make_unique<LinkWorker>(
        io.get_executor(), *config_, link, devices, outbox,
        make_transport(io.get_executor(), config_->links[link], permit_), last_seq, polling_,
        recorder_);
    const std::string& name = config_->links[link].name;
    if (traces_all_ || traced_.contains(name)) worker->trace(true);
    const std::lock_guard lock(places_mutex_);
    places_[link].name = name;
    places_[link].worker = std::move(worker);
  }

  void spawn(std::uint32_t link) {
    const bool looks_up = !std::holds_alternative<SerialSettings>(config_->links[link].channel);
    if (looks_up && !std::exchange(looks_up_, true)) start_looking_up(io.get_executor());
    places_[link].runs = true;
    ++running_;
    asio::co_spawn(io, places_[link].worker->run(), [this, link](std::exception_ptr bug) {
      report_end(bug, places_[link].name);
      places_[link].runs = false;
      --running_;
      // The coroutine's frame may still exist, so the worker is destroyed later.
      if (places_[link].ends) asio::post(io, [this, link] { link_left(link); });
      leave_if_over();
    });
  }

  void leave_if_over() {
    if (stopping_ && running_ == 0) io.stop();
  }

  LinkWorker* worker_of(const DeviceConfig& device) {
    return device.is_vacant() ? nullptr : places_[device.link].worker.get();
  }

  void link_left(std::uint32_t link) {
    if (stopping_) return;  // stop() still collects its counters
    std::unique_lock lock(places_mutex_);
    const Place ended = std::exchange(places_[link], {});
    lock.unlock();
    left(ended.worker->devices());
  }

  void left(const LinkDevices& gone) {
    for (const auto& device : gone) {
      last_numbers_[device->config.name] = device->seq;
      ended_collected_ += device->collected;
      ended_suppressed_ += device->suppressed;
    }
    if (--still_to_leave_ > 0 || stopping_) return;
    report();
    std::exchange(end_done_, {})();
  }

  void begin_next() {
    if (stopping_) return to_begin_.clear();
    if (to_begin_.empty()) return std::exchange(begin_done_, {})();
    begin_one(to_begin_.begin());
    asio::post(io, [this] { begin_next(); });
  }

  void begin_one(std::deque<ToBegin>::iterator which) {
    const ToBegin next = std::move(*which);
    to_begin_.erase(which);
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
      log::error(
          "link",
          {{"link", config_->links[next.link].name},
           {"state", "not begun"},
           {"reason", error.what()},
           {"note", "the agent refuses commands for this link until the agent is restarted"}});
      const std::lock_guard lock(places_mutex_);
      if (!places_[next.link].runs) places_[next.link].worker.reset();
    }
  }

  /// Begins the device at once, because a command has come for it.
  void begin_for(std::uint32_t device) {
    const auto which = std::ranges::find(to_begin_, std::vector{device}, &ToBegin::devices);
    if (which != to_begin_.end() && !stopping_) begin_one(which);
  }

  const Polling polling_;
  FlightRecorder* const recorder_;
  const LinePermit* const permit_;  ///< null: requests may be sent at any time
  asio::steady_timer report_timer_;
  /// Owned by this field and, after a reload, by the change that it came with.
  std::shared_ptr<const Config> config_;
  /// Changed on the field thread only. Other threads read names and workers under places_mutex_.
  std::vector<Place> places_;
  mutable std::mutex places_mutex_;
  std::deque<asio::signal_set> signals_;
  bool looks_up_ = false;         ///< the thread for name lookups was started
  std::set<std::string> traced_;  ///< names of links that are traced from their beginning
  bool traces_all_ = false;       ///< all links are
  bool stopping_ = false;
  std::size_t running_ = 0;  ///< workers whose coroutine has not ended

  // a changed config
  std::size_t still_to_leave_ = 0;
  Done end_done_;
  std::deque<ToBegin> to_begin_;
  std::vector<std::uint64_t> last_seq_;  ///< of the devices that begin
  Done begin_done_;
  std::map<std::string, std::uint64_t> last_numbers_;  ///< by name: ended or renumbered devices
  std::uint64_t ended_collected_ = 0;
  std::uint64_t ended_suppressed_ = 0;
};

Field::Field(const Config& config, Outbox& outbox, const std::vector<std::uint64_t>& last_seq,
             Polling polling, FlightRecorder* recorder, const LinePermit* permit)
    : field_(std::make_unique<Thread>(config, outbox, last_seq, polling, recorder, permit)) {}

Field::~Field() { stop(); }

void Field::trace(const std::vector<std::uint32_t>& links) { field_->trace(links); }

void Field::switch_traces_at(int signal) {
  call_at(signal, [field = field_.get()] { field->switch_traces(); });
}
void Field::call_at(int signal, const std::function<void()>& act) { field_->call_at(signal, act); }

void Field::start() {
  field_->begin_loops();
  const WithoutSignals quiet;
  field_->thread = std::thread([field = field_.get()] { field->io.run(); });
}

void Field::number_above(std::vector<std::uint64_t> last_seq) {
  asio::post(field_->io,
             [field = field_.get(), moved = std::move(last_seq)] { field->number_above(moved); });
}

void Field::submit(AdmittedCommand admitted) {
  const std::lock_guard lock(field_->over);
  if (field_->is_over) return field_->take(std::move(admitted));
  asio::post(field_->io, [field = field_.get(), moved = std::move(admitted)]() mutable {
    field->take(std::move(moved));
  });
}

void Field::report() {
  asio::post(field_->io, [field = field_.get()] { field->report(); });
}

void Field::yield(std::string link, std::chrono::minutes time, std::string text,
                  std::function<void(Reason)> told) {
  asio::post(field_->io, [field = field_.get(), link = std::move(link), time,
                          text = std::move(text), told = std::move(told)]() mutable {
    field->yield(link, time, text, std::move(told));
  });
}

void Field::ask(std::function<void()> answer) { asio::post(field_->io, std::move(answer)); }

void Field::end(std::shared_ptr<const ConfigChange> change, Done done) {
  asio::post(field_->io,
             [field = field_.get(), change = std::move(change), done = std::move(done)]() mutable {
               field->end(*change, std::move(done));
             });
}

void Field::begin(std::shared_ptr<const ConfigChange> change, std::vector<std::uint64_t> last_seq,
                  Done done) {
  asio::post(field_->io, [field = field_.get(), change = std::move(change),
                          last_seq = std::move(last_seq), done = std::move(done)]() mutable {
    field->begin(change, std::move(last_seq), std::move(done));
  });
}

void Field::stop() {
  if (!field_->thread.joinable()) return;
  field_->outbox.refuse_commands();
  asio::post(field_->io, [field = field_.get()] { field->stop(); });
  field_->thread.join();
  field_->io.restart();
  field_->report();
  const std::lock_guard lock(field_->over);
  field_->io.poll();  // commands that came during the last moments are answered too
  field_->is_over = true;
}

std::string Field::unfinished() const { return field_->unfinished(); }

}  // namespace fxagent
