// The journal of commands as commands.h needs it: everything that a restart must know. The store
// keeps it on disk. Uplink thread, except the marks of commands that start.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "protocol/value/bytes.h"

namespace fxagent {

/// Limits of remembered ids: kRememberedIds per device with their first results, kFingerprints of
/// all devices without. An id expires after kRememberedFor, but not before the deadline of its
/// command.
inline constexpr std::size_t kRememberedIds = 10000;
inline constexpr std::size_t kRememberedRefused = 2000;  ///< in addition, per device
inline constexpr std::size_t kFingerprints = 200000;
inline constexpr std::chrono::hours kRememberedFor{24};
/// The year 2200. A later time of a command is damage.
inline constexpr std::int64_t kLatestMs = 7258118400000;

/// Stands in the text of a result until its total_ms is known. Inside a string its quotes would be
/// escaped.
inline constexpr std::string_view kNoTotal = R"("total_ms":null)";
inline constexpr std::string_view kTotalKey = kNoTotal.substr(0, kNoTotal.size() - 4);

/// Fills in the total_ms of a result that has none. Empty `total_ms`: not known.
inline std::string with_total(std::string result, std::string_view total_ms) {
  // In a DUPLICATE, the one in `first` comes before.
  const auto found = result.rfind(kNoTotal);
  if (found == std::string::npos || total_ms.empty()) return result;
  return result.replace(found + kTotalKey.size(), 4, total_ms);
}

/// What is remembered of the id of a command.
struct KnownId {
  std::string device;
  std::string id;
  std::uint64_t number = 0;  ///< of the command; 0: from before there were any
  std::int64_t received_ms = 0;
  std::int64_t deadline_ms = 0;  ///< of the command; its id is kept at least until then
  bool refused = false;          ///< not admitted; kept while there is room
};

/// Entry of one id, from this or an earlier run.
struct JournalEntry : KnownId {
  std::string op;
  std::string response_topic;
  Bytes correlation;
  std::string result;         ///< empty: none
  bool acknowledged = false;  ///< the broker has the result, or refused it for good
  /// From an earlier run, without a result: it waited when the agent died, and no byte of it left.
  bool surely_not_sent = false;
  std::string payload;  ///< as received; kept until there is a result
  std::string place;    ///< hash of what it changes and where; kept as long
  /// Body of an audit record, written together with this entry; empty: none.
  std::string audit;
};

/// Approximate bytes in memory.
inline std::size_t bytes_of(const JournalEntry& entry) {
  return sizeof(entry) + entry.response_topic.size() + entry.correlation.size() +
         entry.result.size() + entry.payload.size() + entry.place.size();
}

/// PORT: records which commands may have left the agent. After a crash, a restart can distinguish
/// commands that only waited from those that may have been carried out. The field reports to it;
/// the store keeps it.
class CommandStarts {
 public:
  virtual ~CommandStarts() = default;

  /// Receives true if the command may be sent: it is marked, or counts as possibly sent because its
  /// mark could not be written. False: the disk does not answer, so nothing may be sent.
  using Done = std::function<void(bool may_be_sent)>;

  /// Call once for each command, before the first byte that changes anything leaves. Never waits
  /// for the disk: calls `done` at most once, on any thread, perhaps before it returns. If that
  /// takes longer than patience(), the command must not be sent. Field thread.
  virtual void mark(std::uint64_t number, Done done) = 0;
  /// Returns how long to wait for `done`.
  virtual std::chrono::milliseconds patience() const { return std::chrono::seconds(2); }
};

class CommandJournal {
 public:
  virtual ~CommandJournal() = default;

  /// Returns the number of the next command, in journal and audit; higher than any before.
  virtual std::uint64_t next_command_number() = 0;
  /// Adds a record's body to the audit alone.
  virtual void note(std::string audit) = 0;
  /// Writes commands before they are carried out. Returns false if they are not in the journal yet;
  /// they will be once the disk accepts them.
  virtual bool journal(std::span<const JournalEntry> commands) = 0;
  /// True if the disk does not answer. Commands of the last journal() may then never reach the
  /// journal, and must not be carried out.
  virtual bool hangs() const { return false; }
  /// Records results of commands, admitted or not, in one commit. A command's first result stays.
  virtual void record(std::vector<JournalEntry> entries) = 0;
  void record(JournalEntry entry) {
    std::vector<JournalEntry> entries;
    entries.push_back(std::move(entry));
    record(std::move(entries));
  }
  /// Records that the broker has acknowledged the result of the command with this number, or
  /// refused it for good. `total_ms`: as in the published result; empty: not known.
  virtual void acknowledge(std::string device, std::string id, std::uint64_t number,
                           std::string total_ms) = 0;
  /// Returns the port that marks commands of this journal before they leave. It lives as long as
  /// the journal. Null: no marks, so after a crash each command may have left.
  virtual CommandStarts* starts() { return nullptr; }
  /// Returns the entry of this id, even if the disk has not accepted it yet.
  virtual std::optional<JournalEntry> find(const std::string& device, const std::string& id) = 0;
  /// Returns the ids of commands that are over, oldest first, but after all others those whose last
  /// change is not on disk yet. `device` empty: of all devices.
  virtual std::vector<KnownId> known_ids(const std::string& device) = 0;
  /// Returns, in the same order, what the broker has not acknowledged: every command without a
  /// result, and the newest results of each device. `device` empty: of all devices.
  virtual std::vector<JournalEntry> unacknowledged(const std::string& device) = 0;
  /// False if the last known_ids() or unacknowledged() could not read all, and may later.
  virtual bool was_read() const { return !hangs(); }
};

}  // namespace fxagent
