// Logs the frames of one link as they pass: time, direction, bytes and meaning. For an engineer
// with a serial problem; exists only while the link is traced. The log thread explains the frames,
// so that a trace delays no poll. Field thread.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "agent/command_message.h"
#include "agent/field/bus/exchange.h"
#include "agent/steady_time.h"
#include "protocol/codec.h"
#include "protocol/value/bytes.h"

namespace fxagent {

class WireTrace final {
 public:
  /// `link`: its name in the config.
  explicit WireTrace(std::string link) : link_(std::move(link)) {}

  /// Sets the device of the following frames; its codec explains them.
  void speak_to(std::string_view device, std::shared_ptr<const Codec> codec);

  /// Logs the bytes that left the agent.
  void out(ByteView bytes) const;
  /// Logs an answer; `after` is the time since the first byte of its request left.
  void answer(ByteView bytes, std::chrono::nanoseconds after) const;
  /// Logs a missing answer: `bytes`, possibly none, came within that time. `why` says what is
  /// wrong; empty: the answer is missing or incomplete.
  void no_answer(ByteView bytes, std::chrono::nanoseconds within, std::string why) const;
  /// Logs how the wait for an answer ended at `now`: by the answer, which is part of `bytes`, or
  /// without it. `deadline` is that of the answer.
  void ended(const Exchange& exchange, ByteView bytes, SteadyTime now, SteadyTime deadline) const;
  /// Logs bytes that came when no answer was due, or around one.
  void unasked(ByteView bytes) const;

 private:
  /// Controls whether the log line explains the bytes, after `note`.
  enum class Explained : std::uint8_t { yes, no };
  void show(WireFrame::Way way, ByteView bytes, std::chrono::nanoseconds after, std::string note,
            Explained explained) const;

  const std::string link_;
  std::string device_;
  /// Owned by the device and by frames waiting to be explained: the log thread may hold the last
  /// reference.
  std::shared_ptr<const Codec> codec_;
};

}  // namespace fxagent
