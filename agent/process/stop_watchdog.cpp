#include "agent/process/stop_watchdog.h"

#include <poll.h>
#include <pthread.h>
#include <unistd.h>

#include <algorithm>
#include <utility>

#include "agent/log/log.h"

namespace fxagent {
namespace {

// A pipe that is reported as writable accepts this many bytes at once (POSIX).
constexpr std::size_t kAtOnce = 512;

/// Writes to stderr in the format of the log; nothing if the reader is stuck. Does not use the log,
/// because the thread that hangs may hold its lock.
void write_last_line(std::string text) {
  text.resize(std::min(text.size(), kAtOnce - 1));
  text += '\n';
  pollfd out{STDERR_FILENO, POLLOUT, 0};
  if (poll(&out, 1, 0) != 1 || (out.revents & POLLOUT) == 0) return;
  [[maybe_unused]] const auto written = ::write(STDERR_FILENO, text.data(), text.size());
}

}  // namespace

StopWatchdog::StopWatchdog(const sigset_t& stop_signals)
    : thread_([this, stop_signals] { run(stop_signals); }) {}

StopWatchdog::~StopWatchdog() {
  {
    const std::lock_guard lock(mutex_);
    over_ = true;
  }
  news_.notify_all();
  pthread_kill(thread_.native_handle(), SIGTERM);  // it may still wait for a signal
  thread_.join();
}

std::optional<int> StopWatchdog::await_signal(std::chrono::steady_clock::time_point deadline) {
  std::unique_lock lock(mutex_);
  if (!news_.wait_until(lock, deadline, [this] { return signal_ != 0; })) return std::nullopt;
  return signal_;
}

bool StopWatchdog::has_signal() {
  const std::lock_guard lock(mutex_);
  return signal_ != 0;
}

void StopWatchdog::begin(const char* what) {
  const std::lock_guard lock(mutex_);
  begun_ = true;
  what_ = what;
}

void StopWatchdog::stage(const char* what, std::function<std::string()> more) {
  const std::lock_guard lock(mutex_);
  what_ = what;
  more_ = std::move(more);
}

void StopWatchdog::nothing_left_to_lose() {
  {
    const std::lock_guard lock(mutex_);
    freeing_ = true;
    more_ = {};
  }
  news_.notify_all();
}

void StopWatchdog::run(const sigset_t& stop_signals) {
  int signal = 0;
  sigwait(&stop_signals, &signal);
  const auto asked = std::chrono::steady_clock::now();
  std::unique_lock lock(mutex_);
  if (!begun_ && !over_) _exit(0);
  signal_ = signal;
  news_.notify_all();
  const auto ended = [this] { return over_ || freeing_; };
  if (!news_.wait_until(lock, asked + kPatience, ended)) end_by_force(kEndedByForce);
  if (over_) return;
  const auto freed_by = std::min(asked + kPatience, std::chrono::steady_clock::now() + kFreeing);
  if (!news_.wait_until(lock, freed_by, [this] { return over_; })) end_by_force(0);
}

void StopWatchdog::end_by_force(int status) {
  if (status != 0) {
    const std::string more = more_ ? more_() : std::string();
    write_last_line(
        log::line(log::Level::error, "agent",
                  {{"state", "ended_by_force"},
                   {"waited_s", std::to_string(kPatience.count())},
                   {"unfinished", more.empty() ? std::string(what_) : what_ + (": " + more)}}));
  }
  _exit(status);
}

}  // namespace fxagent
