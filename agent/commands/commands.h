// Commands from their message to the field, and back to their result. Each message gets exactly one
// result. In each step the uplink calls finish() for what the field has done, receive() for new
// messages, hand_over(), and results().take(). After a reload: begin_change(), change(),
// recover_joined(). CommandAdmission decides and remembers ids, CommandResults records. No threads,
// no clock, no I/O except the journal's. Uplink thread; Commands::restore() also before that thread
// starts. The command line uses CommandAdmission directly.
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
#include "agent/commands/command_results.h"
#include "agent/commands/journal.h"
#include "agent/commands/recovery.h"
#include "agent/config/config_difference.h"
#include "agent/config/model.h"
#include "agent/handover/command_message.h"

namespace fxagent {

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
