// An admitted command with everything that the field has to send.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "agent/commands/journal.h"
#include "agent/commands/shared_admission.h"
#include "agent/handover/command_message.h"
#include "protocol/codec.h"

namespace fxagent {

/// One place that an admitted command reads or writes.
struct AdmittedTarget {
  std::string tag;  ///< as in the command; empty: by address
  std::optional<std::uint32_t> tag_index;
  Point point;
  Bytes image;                    ///< bytes to write; empty for a read
  std::optional<Value> written;   ///< the same in engineering units, decoded from the raw words
  std::vector<Request> requests;  ///< the writes in order; empty for a read
  std::optional<Value> expected;  ///< value that the device must hold before; nullopt: any
  std::chrono::nanoseconds line_time{0};  ///< of all its exchanges, as far as known
};

/// A command on its way to the wire.
struct AdmittedCommand {
  Command command;
  /// Codec of admission and preparation. The device's model may be identified as another one later.
  std::shared_ptr<const Codec> codec;
  std::vector<AdmittedTarget> targets;  ///< empty for run and stop
  std::optional<Request> run_request;   ///< of run and stop: the request that switches the PLC
  bool verify_words = true;
  bool verify_bits = false;
  bool interrupted = false;         ///< left by an earlier run: only its outcome is read
  CommandStarts* starts = nullptr;  ///< marked before it leaves; null: no marks. Outlives the field
  SteadyTime deadline{};            ///< not sent after this
  SteadyTime queued{};              ///< when the field received it
  /// Line time of its own exchanges if each succeeds; nullopt: not known.
  std::optional<std::chrono::nanoseconds> line_time;
  std::optional<std::chrono::nanoseconds> bound;
  /// Its share of the room for pending commands. Commands holds it until there is a result.
  SharedAdmission::Place place{};
};

/// Returns its entry for the journal, without payload and audit record. `device` is the name.
inline JournalEntry entry_of(const AdmittedCommand& admitted, std::string device) {
  const Command& command = admitted.command;
  const auto expiry =
      std::chrono::ceil<std::chrono::milliseconds>(admitted.deadline - command.received);
  JournalEntry entry;
  entry.device = std::move(device);
  entry.id = command.id;
  entry.number = command.number;
  entry.received_ms = command.received_ms;
  entry.deadline_ms = command.received_ms + expiry.count();
  entry.op = command.op_text;
  entry.response_topic = command.response_topic;
  entry.correlation = command.correlation;
  return entry;
}

}  // namespace fxagent
