// The journal of commands, as the commands need it: what is to be known of them after a restart.
// The store keeps it on disk. Uplink thread.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "agent/commands/command_starts.h"
#include "protocol/bytes.h"

namespace fxagent {

/// So many ids of a device are remembered with their first results, and of all devices so many
/// without; so long, whichever ends first, and each at least until the deadline of its command.
inline constexpr std::size_t kRememberedIds = 10000;
inline constexpr std::size_t kRememberedRefused = 2000;  ///< beside them, of a device
inline constexpr std::size_t kFingerprints = 200000;
inline constexpr std::chrono::hours kRememberedFor{24};

/// What the journal says about one id of one device, in this or an earlier run.
struct JournalEntry {
  std::string device;
  std::string id;
  std::int64_t received_ms = 0;
  std::int64_t deadline_ms = 0;  ///< remembered at least until then
  std::string op;
  std::string response_topic;
  Bytes correlation;
  std::string result;         ///< empty: it has none
  bool acknowledged = false;  ///< the broker has the result
  std::uint64_t number = 0;   ///< its number in the audit; 0: it came before there was one
  std::string payload;        ///< as it came; kept until there is a result
  bool refused = false;       ///< it was not admitted: kept while there is room to spare
  /// Of an earlier run, without a result: it waited when the agent died, and no byte of it left.
  bool surely_not_sent = false;
  /// A record's body for the audit, written together with this entry; empty: none.
  std::string audit;
};

/// In memory, roughly.
inline std::size_t bytes_of(const JournalEntry& entry) {
  return sizeof(entry) + entry.response_topic.size() + entry.correlation.size() +
         entry.result.size() + entry.payload.size();
}

/// An id whose command has its result.
struct KnownId {
  std::string device;
  std::string id;
  std::uint64_t number = 0;  ///< of the command
  std::int64_t received_ms = 0;
  std::int64_t deadline_ms = 0;  ///< of the command: its id is kept at least until then
  bool refused = false;          ///< it was not admitted
};

class CommandJournal {
 public:
  virtual ~CommandJournal() = default;

  /// The number of the next command, in the journal and in the audit: higher than any before.
  virtual std::uint64_t next_command_number() = 0;
  /// A record's body for the audit alone.
  virtual void note(std::string audit) = 0;
  /// Writes commands down before they are carried out. False: they are not in the journal yet, and
  /// will be when the disk takes them.
  virtual bool journal(std::span<const JournalEntry> commands) = 0;
  /// True if the disk does not answer. What journal() had to write then may never be in the
  /// journal, and such a command must not be carried out.
  virtual bool hangs() const { return false; }
  /// Notes the result of a command, admitted or not. The first result stays.
  virtual void record(JournalEntry entry) = 0;
  /// The same for several, in one commit.
  virtual void record(std::vector<JournalEntry> entries) = 0;
  /// The broker has the result of the command with this number. `total_ms`: what stands there in
  /// the result as it was published; empty: that is not known.
  virtual void acknowledge(std::string device, std::string id, std::uint64_t number,
                           std::string total_ms) = 0;
  /// Who is told before a command of this journal leaves, while the journal lives; null: nobody,
  /// and after a crash each may have left.
  virtual CommandStarts* starts() { return nullptr; }
  /// What the journal has of this id, or will have once the disk takes it.
  virtual std::optional<JournalEntry> find(const std::string& device, const std::string& id) = 0;
  /// Of those that are over; oldest first.
  virtual std::vector<KnownId> known_ids() = 0;
  /// Of what the broker has not acknowledged every command without a result, and of each device the
  /// newest results; oldest first.
  virtual std::vector<JournalEntry> unacknowledged() = 0;
  // The same of one device, which joins in the middle of a run.
  virtual std::vector<KnownId> known_ids_of(const std::string& device) {
    auto ids = known_ids();
    std::erase_if(ids, [&device](const KnownId& each) { return each.device != device; });
    return ids;
  }
  virtual std::vector<JournalEntry> unacknowledged_of(const std::string& device) {
    auto entries = unacknowledged();
    std::erase_if(entries, [&device](const JournalEntry& each) { return each.device != device; });
    return entries;
  }
};

}  // namespace fxagent
