#include "agent/store/journal/command_marker.h"

#include <system_error>
#include <utility>

#include "agent/without_signals.h"

namespace fxagent {

using Clock = std::chrono::steady_clock;

CommandMarker::CommandMarker(Write write) : write_(std::move(write)) {
  const WithoutSignals quiet;
  try {
    thread_ = std::jthread([this](const std::stop_token& stop) { serve(stop); });
  } catch (const std::system_error&) {
    // No thread: mark() writes itself.
  }
}

CommandMarker::~CommandMarker() = default;

void CommandMarker::mark(std::uint64_t number, Done done) {
  if (!thread_.joinable()) {
    write_(number);
    return done(true);
  }
  std::unique_lock lock(mutex_);
  if (!marks_.empty() && Clock::now() - began_ >= patience_) {
    lock.unlock();
    return done(false);
  }
  if (marks_.empty()) began_ = Clock::now();
  marks_.push_back({number, std::move(done)});
  lock.unlock();
  news_.notify_one();
}

void CommandMarker::serve(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  while (news_.wait(lock, stop, [this] { return !marks_.empty(); })) {
    const std::uint64_t number = marks_.front().number;
    lock.unlock();
    write_(number);
    lock.lock();
    const Done done = std::move(marks_.front().done);
    marks_.pop_front();
    began_ = Clock::now();
    lock.unlock();
    done(true);
    lock.lock();
  }
}

}  // namespace fxagent
