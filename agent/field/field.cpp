#include "agent/field/field.h"

#include <asio/io_context.hpp>
#include <asio/post.hpp>
#include <asio/signal_set.hpp>
#include <asio/steady_timer.hpp>
#include <chrono>
#include <deque>
#include <mutex>
#include <thread>
#include <utility>

#include "agent/field/field_links.h"
#include "agent/without_signals.h"

namespace fxagent {
namespace {

constexpr std::chrono::seconds kReportEvery{5};

}  // namespace

/// The thread, and everything that runs on it.
struct Field::Thread {
  Thread(const Config& config, Outbox& to, const std::vector<std::uint64_t>& last_seq,
         Polling polling, FlightRecorder* recorder, const LinePermit* permit)
      : outbox(to), report_timer(io), links(io, config, to, last_seq, polling, recorder, permit) {}

  void report_later() {
    report_timer.expires_after(kReportEvery);
    report_timer.async_wait([this](const asio::error_code& error) {
      if (error || links.is_stopping()) return;
      links.report();
      report_later();
    });
  }

  /// Calls `what` with the arguments, on the thread.
  template <class... Taken, class... Given>
  void post(void (FieldLinks::*what)(Taken...), Given... given) {
    asio::post(io, [this, what, ... given = std::move(given)]() mutable {
      (links.*what)(std::move(given)...);
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

  Outbox& outbox;
  asio::io_context io{1};
  asio::steady_timer report_timer;
  FieldLinks links;
  std::deque<asio::signal_set> signals;
  std::mutex end;
  bool is_over = false;  ///< under `end`: the thread has ended, and submit() answers at once
  std::thread thread;
};

Field::Field(const Config& config, Outbox& outbox, const std::vector<std::uint64_t>& last_seq,
             Polling polling, FlightRecorder* recorder, const LinePermit* permit)
    : field_(std::make_unique<Thread>(config, outbox, last_seq, polling, recorder, permit)) {}

Field::~Field() { stop(); }

void Field::trace(const std::vector<std::uint32_t>& links) { field_->links.trace(links); }

void Field::switch_traces_at(int signal) {
  call_at(signal, [field = field_.get()] { field->links.switch_traces(); });
}
void Field::call_at(int signal, const std::function<void()>& act) {
  Thread::await(field_->signals.emplace_back(field_->io, signal), act);
}

void Field::start() {
  field_->links.start();
  field_->report_later();
  const WithoutSignals quiet;
  field_->thread = std::thread([field = field_.get()] { field->io.run(); });
}

void Field::number_above(std::vector<std::uint64_t> last_seq) {
  field_->post(&FieldLinks::number_above, std::move(last_seq));
}

void Field::submit(AdmittedCommand admitted) {
  const std::lock_guard lock(field_->end);
  if (field_->is_over) return field_->links.take(std::move(admitted));
  field_->post(&FieldLinks::take, std::move(admitted));
}

void Field::report() { field_->post(&FieldLinks::report); }

void Field::yield(std::string link, std::chrono::minutes time, std::string text,
                  std::function<void(Reason)> done) {
  field_->post(&FieldLinks::yield, std::move(link), time, std::move(text), std::move(done));
}

void Field::post(std::function<void()> call) { asio::post(field_->io, std::move(call)); }

void Field::end(std::shared_ptr<const ConfigChange> change, Done done) {
  field_->post(&FieldLinks::end, std::move(change), std::move(done));
}

void Field::begin(std::shared_ptr<const ConfigChange> change, std::vector<std::uint64_t> last_seq,
                  Done done) {
  field_->post(&FieldLinks::begin, std::move(change), std::move(last_seq), std::move(done));
}

void Field::stop() {
  if (!field_->thread.joinable()) return;
  field_->outbox.refuse_commands();
  asio::post(field_->io, [field = field_.get()] {
    field->report_timer.cancel();
    asio::error_code ignored;
    for (asio::signal_set& each : field->signals) each.cancel(ignored);
    // Ends the thread, even if an abandoned name lookup is still running.
    field->links.stop([field] { field->io.stop(); });
  });
  field_->thread.join();
  field_->io.restart();
  field_->links.report();
  const std::lock_guard lock(field_->end);
  field_->io.poll();  // commands that came during the last moments are answered too
  field_->is_over = true;
}

std::string Field::unfinished() const { return field_->links.unfinished(); }

}  // namespace fxagent
