// The field room as a whole: its thread, its links. Everything else in here runs on that thread.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "agent/config/config.h"
#include "agent/messages.h"
#include "agent/outbox.h"

namespace fxagent {

/// Off: devices answer commands only, as the command line wants it.
enum class Polling : std::uint8_t { on, off };

class Field final {
 public:
  /// `config` and `outbox` outlive the field. Nothing runs yet. With a journal each command waits
  /// for go_ahead(), which answers its AdmissionNote in the outbox.
  Field(const Config& config, Outbox& outbox, const RestoredState& restored,
        Polling polling = Polling::on, Journaling journaling = Journaling::off);
  /// Stops, if stop() was not called.
  ~Field();

  /// Starts the thread. Throws std::system_error where there is none.
  void start();
  /// What earlier runs left, where it is found only now: their ids are known from then on, and
  /// numbers go on above theirs. Any thread.
  void restore(RestoredState restored);
  /// Hands a command to the field; exactly one result comes back through the outbox. Any thread.
  void submit(Command command);
  /// The command is in the journal, or there is none to be had. Any thread.
  void go_ahead(std::uint32_t device, std::string id);
  /// Calls `answer` on the field's thread, when its turn comes. Any thread.
  void ask(std::function<void()> answer);
  /// Stops polling, ends the command on each wire within 3 s, answers the waiting ones with FAILED
  /// shutting_down, and joins the thread. After it the outbox holds every result.
  void stop();
  /// The links that have not ended, of many the first ones. Any thread, while stop() waits.
  std::string unfinished() const;

 private:
  class Room;
  std::unique_ptr<Room> room_;
};

}  // namespace fxagent
