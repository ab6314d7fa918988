// Every command of the agent, from its message to its acknowledged result: parsing, admission,
// journal, audit, result text. Commands and CommandResults are the only owners of "exactly one
// result": no other class counts, remembers or records commands and results. No threads, no clock,
// no I/O except the journal's. Uplink thread; Commands::restore() also before that thread starts.
// The command line uses CommandAdmission directly.
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
#include "agent/config/config_difference.h"
#include "agent/config/model.h"
#include "agent/handover/command_message.h"
#include "agent/handover/status.h"

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
  /// `journal` outlives it; null: there is none. Then `keep_total` gets each result whose total is
  /// known, for the memory of ids.
  CommandResults(CommandJournal* journal, std::function<void(const ResultMessage&)> keep_total)
      : journal_(journal), keep_total_(std::move(keep_total)) {}

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
  const std::function<void(const ResultMessage&)> keep_total_;
  std::vector<JournalEntry> to_record_;
  std::vector<ResultMessage> waiting_;
  /// Total latencies of the newest results, by number; the journal gets them when acknowledged.
  std::deque<std::pair<std::uint64_t, std::chrono::nanoseconds>> totals_;
  std::map<CommandStatus, std::uint64_t> counts_;
  std::deque<std::shared_ptr<const LastCommand>> last_;
};

/// Commands from their message to the field, and back to their result.
class Commands final {
 public:
  using Submit = std::function<void(AdmittedCommand)>;
  /// Yields the port of a link as Field::yield(). `done` is called once, on the uplink thread.
  using Yield = std::function<void(const std::string& link, std::chrono::minutes time,
                                   const std::string& text, std::function<void(Reason)> done)>;

  /// `config` and `journal` outlive it. The config may change between begin_change() and change().
  /// `submit` hands a command to the field and must not block; its result comes back through
  /// finish(), exactly once. `journal` null: there is none. `yield` empty: no link yields.
  Commands(const Config& config, Submit submit, CommandJournal* journal = nullptr,
           Yield yield = {});

  /// Returns the index of a device by its name; nullopt if there is none.
  std::optional<std::uint32_t> device_named(std::string_view name) const;
  /// True if a device or a link has the name.
  bool knows(std::string_view name) const;
  /// Returns the results, for their delivery and the status. Valid as long as this object.
  CommandResults& results() { return results_; }

  /// Rejects later commands for devices that end in the change, with `reloading`.
  void begin_change(const ConfigChange& change);
  /// Call when the config is that of the change, and each admitted command of a device that ends
  /// has its result. Devices that begin start to admit.
  void change(const ConfigChange& change, SteadyTime now);
  /// Restores what earlier runs left of devices that are new to this run since a change(). Does
  /// nothing while the journal cannot be read: call again.
  void recover_joined(SteadyTime now, std::int64_t utc_ms);

  /// Takes over what earlier runs left: remembers the ids, adds the results to results(), and
  /// submits the read-back of each interrupted write, or finishes it if reading cannot show the
  /// outcome. Call again for a store that opens late. `utc_ms` is the calendar time of `now`.
  void restore(Recovered known, SteadyTime now, std::int64_t utc_ms);

  /// Takes a message on the command topic of the device with this name, or else of the link. There
  /// is one result for it, in results(), now or later. An admitted command goes to the field
  /// with hand_over(). If nothing in the config has the name, the result is REJECTED, and neither
  /// the command nor its id is remembered.
  void receive(const std::string& name, std::string_view topic, std::string_view payload,
               MessageProperties properties, SteadyTime now, std::int64_t utc_ms);
  /// Writes the commands admitted since the last call to the journal, in one commit, and hands them
  /// to the field. If the journal hangs, rejects all except reads with `store_unavailable`.
  void hand_over(std::int64_t utc_ms);

  /// Takes the result of an admitted command.
  void finish(CommandResult result, std::int64_t utc_ms);
  /// Sets the codec of a device whose model was identified: its addresses may mean something else.
  /// `of_plc`: DeviceStatus::codec_of_plc.
  void set_codec(std::uint32_t device, std::shared_ptr<const Codec> codec,
                 std::shared_ptr<const Codec> of_plc) {
    devices_.at(device)->codec = std::move(codec);
    devices_.at(device)->admission.plc_has(std::move(of_plc));
  }
  /// Rejects every later command that would be admitted, with `shutting_down`.
  void close() { shared_->is_stopping = true; }
  /// Rejects every later command that would be admitted, with `conflict`: another agent, of boot
  /// `other_boot`, has our id. Empty: there is none.
  void set_conflict(const std::string& other_boot) { shared_->conflict = other_boot; }

 private:
  struct Device {
    Device(const DeviceConfig& config, std::shared_ptr<SharedAdmission> shared)
        : name(config.name), admission(config, std::move(shared)), codec(config.codec) {}

    const std::string name;
    CommandAdmission admission;
    std::shared_ptr<const Codec> codec;
    /// Commands without a result, by id, each with its share of the room; null: of an earlier run.
    std::unordered_map<std::string, SharedAdmission::Place> pending;

    /// One of the pending commands may be in progress; the others wait.
    std::size_t waiting() const { return pending.empty() ? 0 : pending.size() - 1; }
  };

  /// Returns a device that is in the config, or was; nullptr if it never was in this run.
  Device* known_device(const std::string& name);
  /// Begins to admit commands of a device, or goes on by its new config.
  void open(std::uint32_t index);
  void list_names();

  void receive_for_link(const LinkConfig& link, std::string_view topic, std::string_view payload,
                        MessageProperties properties, SteadyTime now, std::int64_t utc_ms);
  /// Returns why the command for the link is not carried out; nullopt: it is.
  std::optional<Refusal> refusal_for_link(const LinkConfig& link, const Command& command,
                                          SteadyTime now, std::int64_t utc_ms) const;

  const Config& config_;
  const Submit submit_;
  const Yield yield_;
  CommandJournal* const journal_;
  const std::shared_ptr<SharedAdmission> shared_ = std::make_shared<SharedAdmission>();
  std::vector<std::unique_ptr<Device>> devices_;  ///< by index in Config::devices; null: vacant
  std::unordered_map<std::string_view, std::uint32_t> index_;  ///< index in devices_, by name
  /// Devices that are no longer in the config, by name. Their ids stay known as long as the
  /// contract says, in case they come back.
  std::map<std::string, std::unique_ptr<Device>, std::less<>> departed_;
  std::vector<std::string> joined_;  ///< until recover_joined()
  CommandResults results_;
  std::deque<std::string> link_ids_;  ///< "link id" of the newest commands for links
  std::vector<AdmittedCommand> admitted_;
  std::vector<JournalEntry> to_journal_;  ///< entries of admitted_
};

}  // namespace fxagent
