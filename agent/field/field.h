// The field room as a whole: its thread, its links. Everything else in here runs on that thread.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>

#include "agent/config.h"
#include "agent/messages.h"
#include "agent/outbox.h"

namespace fxagent {

/// Off: devices answer commands only, as the command line wants it.
enum class Polling : std::uint8_t { on, off };

class Field final {
 public:
  /// `config` and `outbox` outlive the field. `first_seq` is the number before each device's first
  /// sample. Nothing runs yet.
  Field(const Config& config, Outbox& outbox, std::uint64_t first_seq,
        Polling polling = Polling::on);
  /// Stops, if stop() was not called.
  ~Field();

  /// Starts the thread.
  void start();
  /// Hands a command to the field; exactly one result comes back through the outbox. Any thread.
  void submit(Command command);
  /// Stops polling, finishes the command on each wire, answers the waiting ones with REJECTED
  /// shutting_down, and joins the thread. After it the outbox holds every result.
  void stop();

 private:
  class Room;
  std::unique_ptr<Room> room_;
};

}  // namespace fxagent
