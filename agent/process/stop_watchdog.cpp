#include "agent/process/stop_watchdog.h"

#include <poll.h>
#include <pthread.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <system_error>
#include <utility>

#include "agent/log/log.h"
#include "agent/without_signals.h"

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

/// Returns a descriptor that is readable while a stop signal is pending.
int open_signals() {
  const int opened = stop_descriptor();
  if (opened < 0) throw std::system_error(errno, std::generic_category(), "stop signals");
  return opened;
}

/// Waits until a stop signal is pending, and returns its number.
int await_pending(int signals) {
  pollfd stop{signals, POLLIN, 0};
  while (poll(&stop, 1, -1) != 1) continue;
  sigset_t pending;
  sigpending(&pending);
  return sigismember(&pending, SIGTERM) == 1 ? SIGTERM : SIGINT;
}

}  // namespace

StopWatchdog::StopWatchdog() : signals_(open_signals()), thread_([this] { run(); }) {}

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
  }
  news_.notify_all();
}

void StopWatchdog::run() {
  const int signal = await_pending(signals_);
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
