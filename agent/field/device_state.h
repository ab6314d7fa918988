// The state of one device as its clients see it: offline, degraded or online, since when and why.
// Pure: facts and time are arguments. Field thread.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "agent/messages.h"
#include "protocol/codec.h"

namespace fxagent {

class DeviceState final {
 public:
  /// What bus, poll scheduler and polls know at this moment.
  struct Facts {
    bool bus_open = false;
    bool never_silent = false;           ///< the bus was closed because it never fell silent
    bool silent = false;                 ///< too many exchanges in a row had no answer
    std::string why_offline{};           ///< bus closed, or silent: for a person
    std::optional<BadReason> first_bad;  ///< of its tags, as they were last collected
  };
  struct Change {
    DeviceStatus status;
    bool other_state = false;  ///< worth a line in the log; else only a detail is new
  };

  /// `device` is an index in Config::devices, `codec` the config's. Offline, "starting".
  DeviceState(std::uint32_t device, const Codec& codec, std::int64_t now_ms);

  /// The device has answered something.
  void answered() { answered_once_ = true; }
  /// True if the device has answered since the start.
  bool has_answered() const { return answered_once_; }
  /// It is silent. Whoever answers next may be another PLC.
  void fell_silent();
  /// False where it must be asked for its model before it is asked for anything else.
  bool is_model_known() const { return model_known_; }
  /// It was asked; nullopt: the answers do not tell.
  void set_model(const std::optional<std::string>& model);
  /// True while a PLC whose model the config names is still to be asked for its own.
  bool compares_model() const { return compares_model_; }
  /// Takes the answer. nullopt: the PLC names no model, and is not asked again.
  void compare_model(const std::optional<std::string>& of_plc);
  /// nullopt: RUN or STOP is not known.
  void set_run(std::optional<bool> run) { run_ = run; }

  /// The state by these facts; one that is degraded by a bad_value stays so for 10 s after it,
  /// since such a place can be a value in one poll and none in the next. Nothing where it is the
  /// one that was reported last. Before the first answer of a device on an open bus there is
  /// nothing to report; a broadcast has no answer and is online there.
  std::optional<Change> update(const Facts& facts, std::int64_t now_ms);
  /// What was reported last.
  const DeviceStatus& reported() const { return reported_; }

 private:
  const bool is_broadcast_;
  const bool asks_model_;
  const std::string model_configured_;  ///< empty: the config leaves it open
  bool compares_model_;
  bool names_model_ = true;  ///< the PLC does when it is asked
  bool model_known_;
  bool model_unclear_ = false;
  bool answered_once_ = false;
  std::optional<std::int64_t> bad_value_ms_;  ///< when a tag was found to hold none of its values
  bool starting_ = true;                      ///< nothing but "starting" was reported
  std::optional<bool> run_;
  std::string model_;
  DeviceStatus reported_;
};

}  // namespace fxagent
