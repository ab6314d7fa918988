// Marks started commands on its own thread, one after the other: a disk that hangs must not hold up
// the field. Field thread, and its own.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <stop_token>
#include <thread>

#include "agent/commands/journal.h"

namespace fxagent {

class CommandMarker final : public CommandStarts {
 public:
  using Write = std::function<void(std::uint64_t number)>;

  /// `write` marks a command on disk; called on the own thread, or on the caller's if no thread can
  /// be started.
  explicit CommandMarker(Write write);
  /// Waits until the marks in progress are made.
  ~CommandMarker() override;
  CommandMarker(const CommandMarker&) = delete;
  CommandMarker& operator=(const CommandMarker&) = delete;

  void set_patience(std::chrono::milliseconds patience) { patience_ = patience; }
  std::chrono::milliseconds patience() const override { return patience_; }
  /// Calls `done` with false at once while a mark takes longer than patience().
  void mark(std::uint64_t number, Done done) override;

 private:
  struct Mark {
    std::uint64_t number = 0;
    Done done;
  };

  void serve(const std::stop_token& stop);

  const Write write_;
  std::chrono::milliseconds patience_ = CommandStarts::patience();
  std::mutex mutex_;  ///< guards the next three
  std::condition_variable_any news_;
  std::deque<Mark> marks_;                         ///< the first is in progress
  std::chrono::steady_clock::time_point began_{};  ///< of the first
  std::jthread thread_;
};

}  // namespace fxagent
