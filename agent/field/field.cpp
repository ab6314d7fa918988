#include "agent/field/field.h"

#include <algorithm>
#include <asio/co_spawn.hpp>
#include <asio/detached.hpp>
#include <asio/io_context.hpp>
#include <asio/post.hpp>
#include <asio/signal_set.hpp>
#include <asio/steady_timer.hpp>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

#include "agent/field/link_worker.h"
#include "agent/field/serial_transport.h"
#include "agent/field/tcp_transport.h"
#include "agent/log/log.h"
#include "agent/process/startup.h"

namespace fxagent {
namespace {

constexpr std::chrono::seconds kReportEvery{5};

std::unique_ptr<Transport> transport_for(const asio::any_io_executor& executor,
                                         const LinkConfig& link) {
  if (const auto* serial = std::get_if<SerialSettings>(&link.channel))
    return make_serial_transport(executor, *serial);
  return make_tcp_transport(executor, std::get<TcpSettings>(link.channel));
}

/// A bug in one link's coroutine must not end the others.
void report_end(const std::exception_ptr& bug, const std::string& link) {
  if (!bug) return;
  try {
    std::rethrow_exception(bug);
  } catch (const std::exception& e) {
    log::error("link", {{"link", link}, {"state", "ended"}, {"bug", e.what()}});
  }
}

}  // namespace

class Field::Room final {
 public:
  Room(const Config& config, Outbox& outbox, const std::vector<std::uint64_t>& last_seq,
       Polling polling)
      : config_(config), outbox_(outbox), report_timer_(io_) {
    const auto devices = devices_by_link(config);
    for (std::uint32_t i = 0; i < config.links.size(); ++i)
      workers_.push_back(std::make_unique<LinkWorker>(
          io_.get_executor(), config, i, devices[i], outbox,
          transport_for(io_.get_executor(), config.links[i]), last_seq, polling));
  }

  void start() {
    if (std::any_of(config_.links.begin(), config_.links.end(), [](const LinkConfig& link) {
          return std::holds_alternative<TcpSettings>(link.channel);
        }))
      start_looking_up(io_.get_executor());
    for (std::size_t i = 0; i < workers_.size(); ++i)
      asio::co_spawn(io_, workers_[i]->run(), [this, i](std::exception_ptr bug) {
        report_end(bug, config_.links[i].name);
        ++ended_;
        leave_if_over();
      });
    report_later();
    const WithoutSignals quiet;
    thread_ = std::thread([this] { io_.run(); });
  }

  void number_above(std::vector<std::uint64_t> last_seq) {
    asio::post(io_, [this, moved = std::move(last_seq)] {
      for (std::uint32_t i = 0; i < moved.size(); ++i)
        workers_[config_.devices[i].link]->number_above(i, moved[i]);
    });
  }

  void submit(AdmittedCommand admitted) {
    const std::lock_guard lock(end_);
    if (over_) return take(std::move(admitted));
    asio::post(io_, [this, moved = std::move(admitted)]() mutable { take(std::move(moved)); });
  }

  void report_soon() {
    asio::post(io_, [this] { report(); });
  }

  void trace(const std::vector<std::uint32_t>& links) {
    for (const std::uint32_t link : links) workers_.at(link)->trace(true);
  }

  void switch_traces_at(int signal) {
    trace_switch_.emplace(io_, signal);
    await_trace_switch();
  }

  void ask(std::function<void()> answer) { asio::post(io_, std::move(answer)); }

  void stop() {
    if (!thread_.joinable()) return;
    outbox_.refuse_commands();
    asio::post(io_, [this] {
      report_timer_.cancel();
      asio::error_code ignored;
      if (trace_switch_) trace_switch_->cancel(ignored);
      stopping_ = true;
      for (const auto& worker : workers_) worker->stop();
      leave_if_over();
    });
    thread_.join();
    io_.restart();
    report();
    const std::lock_guard lock(end_);
    io_.poll();  // commands that came during the last moments are answered too
    over_ = true;
  }

  std::string unfinished() const {
    constexpr int kNamed = 3;
    std::string names;
    int count = 0;
    for (std::size_t i = 0; i < workers_.size(); ++i)
      if (!workers_[i]->has_ended() && ++count <= kNamed)
        names += (names.empty() ? "" : " ") + config_.links[i].name;
    if (count > kNamed) names += " and " + std::to_string(count - kNamed) + " more";
    return names;
  }

 private:
  void take(AdmittedCommand admitted) {
    const std::uint32_t link = config_.devices[admitted.command.device].link;
    workers_[link]->submit(std::move(admitted));
  }

  void await_trace_switch() {
    trace_switch_->async_wait([this](const asio::error_code& cancelled, int) {
      if (cancelled) return;
      const bool on =
          std::ranges::none_of(workers_, [](const auto& worker) { return worker->is_traced(); });
      for (const auto& worker : workers_) worker->trace(on);
      log::info("trace", {{"links", "all"}, {"state", on ? "on" : "off"}});
      await_trace_switch();
    });
  }

  /// A name lookup that nobody waits for any more does not keep the thread.
  void leave_if_over() {
    if (stopping_ && ended_ == workers_.size()) io_.stop();
  }

  void report() {
    FieldHealth health;
    health.links.resize(config_.links.size());
    health.devices.resize(config_.devices.size());
    for (const auto& worker : workers_) worker->report(health);
    outbox_.push(std::move(health));
  }

  void report_later() {
    report_timer_.expires_after(kReportEvery);
    report_timer_.async_wait([this](const asio::error_code& error) {
      if (error || stopping_) return;
      report();
      report_later();
    });
  }

  const Config& config_;
  Outbox& outbox_;
  asio::io_context io_{1};
  asio::steady_timer report_timer_;
  std::optional<asio::signal_set> trace_switch_;
  std::vector<std::unique_ptr<LinkWorker>> workers_;
  bool stopping_ = false;
  std::size_t ended_ = 0;  ///< workers whose coroutine is over
  std::mutex end_;
  bool over_ = false;  ///< the field's thread has ended: who submits is answered at once
  std::thread thread_;
};

Field::Field(const Config& config, Outbox& outbox, const std::vector<std::uint64_t>& last_seq,
             Polling polling)
    : room_(std::make_unique<Room>(config, outbox, last_seq, polling)) {}

Field::~Field() { stop(); }
void Field::trace(const std::vector<std::uint32_t>& links) { room_->trace(links); }
void Field::switch_traces_at(int signal) { room_->switch_traces_at(signal); }
void Field::start() { room_->start(); }
void Field::number_above(std::vector<std::uint64_t> last_seq) {
  room_->number_above(std::move(last_seq));
}
void Field::submit(AdmittedCommand admitted) { room_->submit(std::move(admitted)); }
void Field::report() { room_->report_soon(); }
void Field::ask(std::function<void()> answer) { room_->ask(std::move(answer)); }
void Field::stop() { room_->stop(); }
std::string Field::unfinished() const { return room_->unfinished(); }

}  // namespace fxagent
