// A deadline for the reads and writes of one stream that costs no timer call while traffic flows.
// One wait stays armed; a later deadline only changes a number. Field thread only.
#pragma once

#include <asio/steady_timer.hpp>
#include <limits>

#include "agent/steady_time.h"

namespace fxagent {

/// `Stream` needs cancel(ec). The deadline and its stream must outlive the io_context's last run.
template <class Stream>
class Deadline final {
 public:
  Deadline(asio::any_io_executor executor, Stream& stream) : timer_(executor), stream_(stream) {}
  Deadline(const Deadline&) = delete;
  Deadline& operator=(const Deadline&) = delete;

  /// Cancels the stream's operation at `at`.
  void arm(SteadyTime at) {
    at_ = at;
    passed_ = false;
    if (!waiting_ || at < timer_.expiry()) wait_until(at);
  }
  void disarm() { at_ = SteadyTime::max(); }
  /// Also ends the armed wait, so that an io_context without other work can finish.
  void cancel() {
    disarm();
    waiting_ = false;
    timer_.cancel();
  }
  /// True if the deadline caused the last cancellation.
  bool passed() const { return passed_; }

 private:
  void wait_until(SteadyTime at) {
    waiting_ = true;
    timer_.expires_at(at);
    timer_.async_wait([this](const asio::error_code& error) {
      if (error) return;  // moved to an earlier time, which has a wait of its own
      waiting_ = false;
      if (at_ == SteadyTime::max()) return;
      if (std::chrono::steady_clock::now() < at_) return wait_until(at_);
      passed_ = true;
      asio::error_code ignored;
      stream_.cancel(ignored);
    });
  }

  asio::steady_timer timer_;
  Stream& stream_;
  SteadyTime at_ = SteadyTime::max();
  bool waiting_ = false;
  bool passed_ = false;
};

}  // namespace fxagent
