// Every command of the agent, from its message to its acknowledged result: parse, admission,
// journal, audit, result text. The one owner of "exactly one result": nobody else counts, remembers
// or writes down a command or a result. No threads, no I/O but the journal's, no clock of its own.
// Uplink thread, and before that has started restore(); the command line asks CommandAdmission
// itself.
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
#include <string_view>
#include <unordered_map>
#include <utility>
#include <vector>

#include "agent/commands/admission.h"
#include "agent/commands/audit_records.h"
#include "agent/commands/journal.h"
#include "agent/commands/recovery.h"
#include "agent/config/config.h"
#include "agent/config/config_difference.h"
#include "agent/messages.h"
#include "agent/status.h"

namespace fxagent {

/// A result on its way to the broker.
struct ResultMessage {
  std::string device;        ///< its name; it may be in no config any more
  std::uint64_t number = 0;  ///< of its command
  std::string id;
  std::string text;        ///< JSON; with_total() completes it
  SteadyTime received{};   ///< of its command; the epoch: by an earlier run
  bool sent = false;       ///< to its device
  bool recorded = false;   ///< of an earlier run: the text is complete
  bool is_first = false;   ///< its id is remembered with it
  bool journaled = false;  ///< the journal is to note the acknowledgement
  /// Until it was handed over to MQTT; nullopt: it was not, or an earlier run has done so.
  std::optional<std::chrono::nanoseconds> total;
  std::string response_topic;
  Bytes correlation;
};
/// In memory, roughly.
inline std::size_t bytes_of(const ResultMessage& result) {
  return sizeof(result) + result.device.size() + result.text.size() + result.response_topic.size() +
         result.correlation.size();
}

class Commands final {
 public:
  using Submit = std::function<void(AdmittedCommand)>;

  /// `config` and `journal` outlive it. The config may become another one, where that is told by
  /// begin_change() and change(). `submit` hands a command to the field and must not block;
  /// its result comes back through finish(), exactly once. `journal` null: there is none.
  Commands(const Config& config, Submit submit, CommandJournal* journal = nullptr);

  /// The index of a device by its name; nothing where there is none.
  std::optional<std::uint32_t> device_named(std::string_view name) const;

  /// What ends in the change admits nothing from now on: REJECTED, shutting_down.
  void begin_change(const ConfigChange& change);
  /// The config is that of the change from now on, and no admitted command of what ends in it is
  /// without its result. The devices that begin in it admit. Returns the names of those that this
  /// run has not known before: what earlier runs left of them is to be restored.
  std::vector<std::string> change(const ConfigChange& change, SteadyTime now);

  /// What earlier runs left. `utc_ms` is the calendar time of `now`.
  void restore(Recovered known, SteadyTime now, std::int64_t utc_ms);

  /// A message on the command topic of a device: there is one result for it, in take_results() now
  /// or later. An admitted command goes to the field with hand_over().
  void receive(std::uint32_t device, std::string_view topic, std::string_view payload,
               MessageProperties properties, SteadyTime now, std::int64_t utc_ms);
  /// A message on the command topic of a device that is not in the config. There is one result for
  /// it, too: REJECTED. Neither it nor its id is remembered.
  void refuse_unknown(const std::string& device, std::string_view payload,
                      MessageProperties properties);
  /// Writes the commands admitted since the last call into the journal in one commit, and hands
  /// them to the field. If the journal hangs, each that is not a read is REJECTED,
  /// store_unavailable.
  void hand_over(std::int64_t utc_ms);

  /// What became of an admitted command.
  void finish(CommandResult result, std::int64_t utc_ms);
  /// The device's addresses mean something else now: its model was found.
  void set_codec(std::uint32_t device, std::shared_ptr<const Codec> codec);
  /// From now on no command is admitted: one that would be is REJECTED, shutting_down.
  void close();
  /// Another agent, of this boot, has the id of ours: one that would be admitted is REJECTED,
  /// conflict. Empty: there is none.
  void set_conflict(const std::string& other_boot);

  /// Results for the broker, in the order they came to be; they are in the journal by now.
  std::vector<ResultMessage> take_results();
  /// The result was handed over to MQTT for the first time: `total` is known.
  void note_total(const ResultMessage& result);
  /// The result is over: acknowledged by the broker, or refused for good.
  void note_delivery(const ResultMessage& result, bool acknowledged, std::int64_t utc_ms);

  /// How often each status was given, since the start.
  const std::map<CommandStatus, std::uint64_t>& counts() const { return counts_; }
  /// The newest results of this run, the newest last.
  const std::deque<LastCommand>& last() const { return last_; }

 private:
  struct Device {
    Device(const DeviceConfig& config, Journaling journaling, std::shared_ptr<CommandRoom> room)
        : name(config.name), admission(config, journaling, std::move(room)), codec(config.codec) {}

    const std::string name;
    CommandAdmission admission;
    std::shared_ptr<const Codec> codec;
    /// Commands without a result, by id, and what each takes of the room for them.
    std::unordered_map<std::string, std::shared_ptr<const CommandRoom::Place>> pending;

    /// Beside those that wait one may be under way.
    std::size_t waiting() const { return pending.empty() ? 0 : pending.size() - 1; }
  };

  /// Of a device that is in the config, or was; nullptr: it never was in this run.
  Device* known_device(const std::string& name);
  Device& device_at(std::uint32_t index) { return *devices_.at(index); }
  const std::string& name_of(std::uint32_t index) const { return devices_.at(index)->name; }
  void open(std::uint32_t index);
  void list_names();

  audit::Receipt receipt_of(const Command& command, std::string_view topic,
                            std::string_view payload) const;
  void journal_later(const AdmittedCommand& admitted, std::optional<audit::Receipt> receipt,
                     std::int64_t utc_ms);
  /// `receipt`: how its command came, where that is not in the audit yet.
  void take_result(CommandResult result, const std::optional<audit::Receipt>& receipt,
                   std::int64_t utc_ms);
  void find_first(CommandResult& result);
  std::optional<std::chrono::nanoseconds> total_of(std::uint64_t number) const;
  void record_results();

  const Config& config_;
  const Submit submit_;
  CommandJournal* const journal_;
  const std::shared_ptr<CommandRoom> room_ = std::make_shared<CommandRoom>();
  std::vector<std::unique_ptr<Device>> devices_;  ///< by index in Config::devices; null: vacant
  std::unordered_map<std::string_view, std::uint32_t> index_;  ///< of them, by name
  /// Devices that are in the config no more, by name: their ids are known for as long as the
  /// contract says, should they come back.
  std::map<std::string, std::unique_ptr<Device>, std::less<>> departed_;
  bool closed_ = false;
  std::string conflict_;
  std::vector<AdmittedCommand> admitted_;
  std::vector<JournalEntry> to_journal_;  ///< beside admitted_
  std::vector<JournalEntry> to_record_;
  std::vector<ResultMessage> results_;
  /// The totals of the newest results, by the numbers of their commands: what the journal learns
  /// with the acknowledgement.
  std::deque<std::pair<std::uint64_t, std::chrono::nanoseconds>> totals_;
  std::map<CommandStatus, std::uint64_t> counts_;
  std::deque<LastCommand> last_;
};

}  // namespace fxagent
