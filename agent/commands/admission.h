// Admits the commands of one device: known, writable, in range, fresh, not seen before. Each gets
// one decision: a result at once, or admission to the wire. Pure: time is an argument.
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
#include "agent/commands/id_memory.h"
#include "agent/commands/journal.h"
#include "agent/commands/shared_admission.h"
#include "agent/config/model.h"
#include "agent/handover/command_message.h"
#include "protocol/codec.h"

namespace fxagent {

class CommandAdmission final {
 public:
  using Decision = std::variant<CommandResult, AdmittedCommand>;

  /// `device` must live until the next use(). `shared` is common to the admission of all devices
  /// and to pending commands.
  explicit CommandAdmission(const DeviceConfig& device, std::shared_ptr<SharedAdmission> shared =
                                                            std::make_shared<SharedAdmission>())
      : device_(&device), shared_(std::move(shared)), ids_(shared_, device.name) {}

  /// Decides on `command`, by the checks of the contract in their order. `codec` is the device's
  /// current one (its model may have been identified). `waiting` is the number of commands that
  /// wait for the wire.
  Decision admit(Command command, const std::shared_ptr<const Codec>& codec, std::size_t waiting,
                 SteadyTime now);

  /// Records the result of a command that admit() let through. Call exactly once for each.
  void finished(CommandResult& result);

  /// Rejects every later command that would be admitted, with `reloading`.
  void close() { is_reloading_ = true; }
  /// Continues with another device or config of this name: admits again, and keeps the known ids.
  void use(const DeviceConfig& device) {
    device_ = &device;
    is_reloading_ = false;
  }
  /// The PLC is another model than the codec of admit(): `codec` is that of its own. A command for
  /// a place that has another name there is refused, with `bad_address`. Null: it is not.
  void plc_has(std::shared_ptr<const Codec> codec) { codec_of_plc_ = std::move(codec); }

  /// Restores an id of an earlier run. `utc_ms` is the calendar time of `now`.
  void restore(const KnownId& known, SteadyTime now, std::int64_t utc_ms);

  /// Restores a command that an earlier run journaled but did not finish. Its id is known, without
  /// a result so far. Returns what to read for its outcome, or nullopt if reading cannot show it:
  /// bits, since ladders reset them, and places that the device no longer has.
  std::optional<AdmittedCommand> interrupted(Command command,
                                             const std::shared_ptr<const Codec>& codec,
                                             SteadyTime now);

  /// True if no id of the device needs to be known any more.
  bool has_forgotten(SteadyTime now) { return ids_.is_empty(now); }
  std::size_t remembered() const { return ids_.size(); }

 private:
  /// Remembers the id of a command that was not admitted, if it has one and is no dry run.
  void remember_refused(const Command& command, CommandResult& result, SteadyTime now);
  /// Keeps the text of the result for duplicates, unless the journal does.
  void keep(CommandResult& result, SharedAdmission::ResultOf command);
  /// Takes the command's share of all that is limited, or returns why there is no room.
  std::optional<Refusal> take_room(const Command& command, std::size_t waiting,
                                   SharedAdmission::Place& place, SteadyTime now);
  /// Fills admitted.targets, or returns the check that failed.
  std::optional<Refusal> resolve(const Codec& codec, AdmittedCommand& admitted,
                                 std::vector<TargetResult>& out);
  std::optional<Refusal> resolve_target(const Codec& codec, const Command& command,
                                        const CommandTarget& target, AdmittedTarget& out) const;
  std::optional<Refusal> resolve_place(const Codec& codec, Op op, const CommandTarget& target,
                                       AdmittedTarget& out) const;
  std::optional<Refusal> check_model(const Codec& codec, const Span& span) const;
  std::optional<Refusal> check_access(const Codec& codec, const Command& command,
                                      const AdmittedTarget& target) const;
  std::optional<Refusal> check_value(const Codec& codec, const Command& command,
                                     const CommandTarget& target, AdmittedTarget& out) const;

  const DeviceConfig* device_;  ///< never null
  const std::shared_ptr<SharedAdmission> shared_;
  IdMemory ids_;
  std::shared_ptr<const Codec> codec_of_plc_;
  bool is_reloading_ = false;
};

}  // namespace fxagent
