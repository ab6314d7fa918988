// A command that was admitted, complete with all that is to be sent: what the field carries out.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "agent/commands/command_room.h"
#include "agent/commands/command_starts.h"
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
  std::optional<Value> expected;  ///< what the device must hold before; nullopt: no matter what
  std::chrono::nanoseconds line_time{0};  ///< of all its exchanges, as far as it is known
};

/// A command on its way to the wire.
struct AdmittedCommand {
  Command command;
  /// What it was admitted and made ready with; the device's model may be found to be another later.
  std::shared_ptr<const Codec> codec;
  std::vector<AdmittedTarget> targets;  ///< empty for run and stop
  std::optional<Request> run_request;   ///< of run and stop: what switches the PLC
  bool verify_words = true;
  bool verify_bits = false;
  bool interrupted = false;         ///< by an earlier run: only its outcome is read
  CommandStarts* starts = nullptr;  ///< told before it leaves; null: nobody. Outlives the field
  SteadyTime deadline{};            ///< not sent after this
  SteadyTime queued{};              ///< when the field got it
  /// Line time of its own exchanges when each ends well; nullopt: not known.
  std::optional<std::chrono::nanoseconds> line_time;
  std::optional<std::chrono::nanoseconds> bound;
  /// What it takes of the room for pending commands; Commands keeps it until there is a result.
  std::shared_ptr<const CommandRoom::Place> place{};
};

}  // namespace fxagent
