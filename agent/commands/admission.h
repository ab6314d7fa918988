// Admits the commands of one device: known, writable, in range, fresh, not seen before. Every
// command gets one decision: a result at once, or admission to the wire. Pure: time is an argument.
// Field thread.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "agent/commands/command_room.h"
#include "agent/commands/id_memory.h"
#include "agent/config/config.h"
#include "agent/messages.h"
#include "protocol/codec.h"

namespace fxagent {

/// One place that an admitted command reads or writes.
struct AdmittedTarget {
  std::string tag;  ///< as in the command; empty: by address
  std::optional<std::uint32_t> tag_index;
  Point point;
  Bytes image;                    ///< what is to be written; empty for a read
  std::optional<Value> written;   ///< the same in engineering units, as the raw words say it
  std::vector<Request> requests;  ///< the writes in their order; empty for a read
  Bytes expected;                 ///< raw image that `expect` asks for; empty: no expect
  std::chrono::nanoseconds line_time{0};  ///< of all its exchanges, as far as it is known
};

/// A command on its way to the wire.
struct AdmittedCommand {
  Command command;
  std::vector<AdmittedTarget> targets;  ///< empty for run and stop
  std::optional<Request> run_request;   ///< of run and stop: what switches the PLC
  bool verify_words = true;
  bool verify_bits = false;
  bool interrupted = false;  ///< by an earlier run: only its outcome is read
  SteadyTime deadline{};     ///< not sent after this
  SteadyTime go_ahead{};
  /// Line time of its own exchanges when each ends well; nullopt: not known.
  std::optional<std::chrono::nanoseconds> line_time;
  std::optional<std::chrono::nanoseconds> bound;
  /// What it takes of the room for waiting commands; shared with copies of the command.
  std::shared_ptr<const CommandRoom::Place> place{};
};

class CommandAdmission final {
 public:
  using Decision = std::variant<CommandResult, AdmittedCommand>;

  /// `device` outlives admission. With a journal the first results are there, and not here. `room`
  /// is shared with the admission of the other devices and with the commands that wait.
  explicit CommandAdmission(const DeviceConfig& device, Journaling journaling = Journaling::off,
                            std::shared_ptr<CommandRoom> room = std::make_shared<CommandRoom>())
      : device_(device),
        journaling_(journaling),
        room_(std::move(room)),
        ids_(room_, device.name) {}

  /// The decision on `command`, by the checks of the contract in their order. `codec` is the
  /// device's codec of the moment (its model may have been identified), `waiting` the commands
  /// already queued.
  Decision admit(Command command, const Codec& codec, std::size_t waiting, SteadyTime now);

  /// The result of a command that admit() let through. Each must come back here exactly once.
  void finished(const CommandResult& result);

  /// An id of an earlier run is known from now on. `utc_ms` is the calendar time of `now`.
  void restore(RememberedId remembered, SteadyTime now, std::int64_t utc_ms);

  /// A command that an earlier run had in its journal and did not finish: its id is known, without
  /// a result so far. What is to be read for its outcome; nothing, where reading does not tell:
  /// bits, since ladders reset them, and what cannot be found on the device any more.
  std::optional<AdmittedCommand> interrupted(Command command, const Codec& codec, SteadyTime now);

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

  const DeviceConfig& device_;
  const Journaling journaling_;
  const std::shared_ptr<CommandRoom> room_;
  IdMemory ids_;
};

/// The frame of a result for `command`: ids, times, op, topics; status is for the caller to set.
CommandResult result_of(const Command& command);
/// What became of a command as a whole became of each of its targets: sets `status` and `reason` of
/// all, and `detail` of the command.
void set_outcome(CommandResult& result, CommandStatus status, Reason reason, std::string detail);
/// A target's name and place, without an outcome.
TargetResult result_of(const AdmittedTarget& target);

}  // namespace fxagent
