// The results of all commands on their way to the broker. Uplink thread. No I/O except the
// journal's.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "agent/commands/audit_records.h"
#include "agent/commands/journal.h"
#include "agent/handover/command_message.h"
#include "agent/handover/status.h"
#include "agent/steady_time.h"
#include "protocol/value/bytes.h"

namespace fxagent {

/// A result on its way to the broker.
struct ResultMessage {
  std::string device;        ///< its name, which may no longer be in the config
  std::uint64_t number = 0;  ///< of its command
  std::string id;
  std::string text;       ///< JSON; with_total() completes it
  SteadyTime received{};  ///< of its command; epoch: by an earlier run
  bool sent = false;      ///< the command was sent to its device
  bool recorded = false;  ///< from an earlier run: the text is complete
  bool is_first = false;  ///< remembered with its id, and in the journal if there is one
  /// Total latency until the hand-over to MQTT; nullopt: not handed over, or by an earlier run.
  std::optional<std::chrono::nanoseconds> total{};
  std::string response_topic;
  Bytes correlation;
  std::function<void(const std::string& result)> reply;  ///< as in MessageProperties
  std::weak_ptr<std::string> kept;                       ///< as in CommandResult
};
/// Approximate bytes in memory.
inline std::size_t bytes_of(const ResultMessage& result) {
  return sizeof(result) + result.device.size() + result.text.size() + result.response_topic.size() +
         result.correlation.size();
}

/// Results on their way to the broker: counted, shown in the status, recorded in the journal and
/// the audit, and queued until the uplink takes them. Completes a DUPLICATE with the first result.
class CommandResults final {
 public:
  /// `journal` outlives it; null: there is none.
  explicit CommandResults(CommandJournal* journal) : journal_(journal) {}

  // Commands calls one of these for each command.
  /// Takes the result for a device. `receipt`: of its command, if that is not in the audit yet.
  void add(const std::string& device, CommandResult result,
           const std::optional<audit::Receipt>& receipt, std::int64_t utc_ms);
  /// Takes the result of a command for a link. The journal does not remember its id.
  void add_for_link(const std::string& link, CommandResult result, const audit::Receipt& receipt,
                    std::int64_t utc_ms);
  /// Takes the refusal for a name that is not in the config. Neither journal nor audit has it.
  void add_unrecorded(const std::string& name, CommandResult result);
  /// Counts a result that was not added: only its sender gets it.
  void count(CommandStatus status) { ++counts_[status]; }

  /// Returns results for the broker, in the order in which they came. The journal has those of
  /// admitted commands by now.
  std::vector<ResultMessage> take();
  /// Call when the result was handed over to MQTT for the first time: `total` is known.
  void note_total(const ResultMessage& result);
  /// Call when the broker has acknowledged the result, or refused it for good.
  void note_delivery(const ResultMessage& result, bool acknowledged, std::int64_t utc_ms);

  /// Number of results by status, since the start.
  const std::map<CommandStatus, std::uint64_t>& counts() const { return counts_; }
  /// Newest results of this run, newest last.
  const std::deque<std::shared_ptr<const LastCommand>>& last() const { return last_; }

 private:
  void note_last(const std::string& device, const CommandResult& result, std::int64_t utc_ms);
  void find_first(const std::string& device, CommandResult& result);
  void record();

  CommandJournal* const journal_;
  std::vector<JournalEntry> to_record_;
  std::vector<ResultMessage> waiting_;
  /// Total latencies of the newest results, by number; the journal gets them when acknowledged.
  std::deque<std::pair<std::uint64_t, std::chrono::nanoseconds>> totals_;
  std::map<CommandStatus, std::uint64_t> counts_;
  std::deque<std::shared_ptr<const LastCommand>> last_;
};

}  // namespace fxagent
