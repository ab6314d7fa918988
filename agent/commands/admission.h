// Admits the commands of one device: known, writable, in range, fresh, not seen before. Every
// command gets one decision: a result at once, or admission to the wire. Pure: time is an argument.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "agent/commands/admitted_command.h"
#include "agent/commands/command_room.h"
#include "agent/commands/id_memory.h"
#include "agent/commands/journal.h"
#include "agent/config/config.h"
#include "agent/messages.h"
#include "protocol/codec.h"

namespace fxagent {

/// On: first results are kept in the journal. Off: there is none.
enum class Journaling : std::uint8_t { off, on };

class CommandAdmission final {
 public:
  using Decision = std::variant<CommandResult, AdmittedCommand>;

  /// `device` outlives admission, or its use(). With a journal the first results are there, and not
  /// here. `room` is shared with the admission of the other devices and with the commands that
  /// wait.
  explicit CommandAdmission(const DeviceConfig& device, Journaling journaling = Journaling::off,
                            std::shared_ptr<CommandRoom> room = std::make_shared<CommandRoom>())
      : device_(&device),
        journaling_(journaling),
        room_(std::move(room)),
        ids_(room_, device.name) {}

  /// The decision on `command`, by the checks of the contract in their order. `codec` is the
  /// device's codec of the moment (its model may have been identified), `waiting` the commands
  /// that wait for the wire.
  Decision admit(Command command, const std::shared_ptr<const Codec>& codec, std::size_t waiting,
                 SteadyTime now);

  /// The result of a command that admit() let through. Each must come back here exactly once.
  void finished(const CommandResult& result);

  /// How long the first result of this id took until it was handed over.
  void note_total(const std::string& id, std::chrono::nanoseconds total) {
    ids_.note_total(id, total);
  }

  /// From now on no command is admitted: one that would be is REJECTED, shutting_down. `why` is for
  /// people.
  void close(std::string why = {}) {
    closed_ = true;
    why_closed_ = std::move(why);
  }
  /// From now on the device is another one of the same name: it admits, and knows the ids of
  /// before.
  void use(const DeviceConfig& device) {
    device_ = &device;
    closed_ = false;
  }

  /// Another agent, of this boot, has the id of ours: a command that would be admitted is REJECTED,
  /// conflict. Empty: there is none.
  void set_conflict(std::string other_boot) { conflict_ = std::move(other_boot); }

  /// An id of an earlier run is known from now on. `utc_ms` is the calendar time of `now`.
  void restore(const KnownId& known, SteadyTime now, std::int64_t utc_ms);

  /// A command that an earlier run had in its journal and did not finish: its id is known, without
  /// a result so far. What is to be read for its outcome; nothing, where reading does not tell:
  /// bits, since ladders reset them, and what cannot be found on the device any more.
  std::optional<AdmittedCommand> interrupted(Command command,
                                             const std::shared_ptr<const Codec>& codec,
                                             SteadyTime now);

  /// Whether no id of the device needs to be known any more.
  bool has_forgotten(SteadyTime now) { return ids_.is_empty(now); }
  std::size_t remembered() const { return ids_.size(); }

 private:
  /// Remembers the id of a command that was not admitted; nothing of a dry run.
  void remember_refused(const Command& command, const CommandResult& result, SteadyTime now);
  /// Fills admitted.targets, or says which check failed.
  std::optional<Refusal> resolve(const Codec& codec, AdmittedCommand& admitted,
                                 std::vector<TargetResult>& out);
  std::optional<Refusal> resolve_target(const Codec& codec, const Command& command,
                                        const CommandTarget& target, AdmittedTarget& out) const;
  std::optional<Refusal> resolve_place(const Codec& codec, Op op, const CommandTarget& target,
                                       AdmittedTarget& out) const;
  std::optional<Refusal> check_access(const Codec& codec, const Command& command,
                                      const AdmittedTarget& target) const;
  std::optional<Refusal> check_value(const Codec& codec, const Command& command,
                                     const CommandTarget& target, AdmittedTarget& out) const;

  const DeviceConfig* device_;  ///< never null
  const Journaling journaling_;
  const std::shared_ptr<CommandRoom> room_;
  IdMemory ids_;
  bool closed_ = false;
  std::string why_closed_;
  std::string conflict_;  ///< boot of another agent with our id
};

}  // namespace fxagent
