// The state of one device as its clients see it: offline, degraded, online or yielded, since when
// and why. Pure: facts and time are arguments. Field thread.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "agent/handover/telemetry.h"
#include "protocol/codec.h"

namespace fxagent {

class DeviceState final {
 public:
  /// Current facts from the bus, the poll scheduler and the polls.
  struct Facts {
    bool bus_open = false;
    bool never_silent = false;  ///< the bus was closed because it never fell silent
    bool silent = false;        ///< too many consecutive exchanges had no answer
    std::string yielded{};      ///< until when the port is another program's; empty: it is ours
    std::string why_offline{};  ///< why the bus is closed or the device is silent, for people
    std::optional<BadReason> first_bad;  ///< of its tags, from their last cycles
    std::string bad_tag{};               ///< its name and what to do, for people
  };
  struct Change {
    DeviceStatus status;
    bool other_state = false;  ///< worth a line in the log; otherwise only a detail has changed
  };

  /// `device`: index in Config::devices. `codec`: the config's. Begins as offline, "starting".
  DeviceState(std::uint32_t device, const Codec& codec, std::int64_t now_ms);

  /// Records that the device has answered something.
  void answered() { answered_once_ = true; }
  /// True if the device has answered since the start.
  bool has_answered() const { return answered_once_; }
  /// Records that the device is silent. The next device to answer may be another PLC.
  void fell_silent();

  // With "model": "auto" in the config:
  /// False if the device must be asked for its model before anything else.
  bool is_model_known() const { return model_known_; }
  /// Records the model; nullopt: the answers do not identify it.
  void set_model(const std::optional<std::string>& model);

  // With a model in the config:
  /// True while the PLC has yet to be asked for its own model, also after a silence.
  bool must_compare_model() const { return must_compare_model_; }
  /// Records the PLC's own model. nullopt: the PLC names no model and is not asked again.
  void set_model_of_plc(const std::optional<std::string>& model);
  /// Records a question without an answer. After three, the PLC is not asked until it was silent.
  void comparison_unanswered();

  /// Records the RUN state; nullopt: unknown.
  void set_run(std::optional<bool> run) { run_ = run; }

  /// Returns the state by these facts, or nullopt if it was already reported. After a bad_value the
  /// device stays degraded for 10 s: its place may hold a value in one poll and none in the next.
  /// On an open bus, also returns nullopt until the device has answered; a broadcast never answers
  /// and is online.
  std::optional<Change> update(const Facts& facts, std::int64_t now_ms);
  /// Returns the last reported state.
  const DeviceStatus& reported() const { return reported_; }

 private:
  const bool is_broadcast_;
  const bool asks_model_;
  const std::string model_configured_;  ///< empty: the config leaves the model open
  bool must_compare_model_;
  bool names_model_ = true;  ///< the PLC names its model when asked
  int comparisons_unanswered_ = 0;
  bool model_known_;
  bool model_unclear_ = false;
  bool answered_once_ = false;
  std::optional<std::int64_t> bad_value_ms_;  ///< time of the last bad_value
  std::string bad_value_tag_;                 ///< its tag, for people
  std::int64_t text_ms_ = 0;                  ///< time of the last change of the reported text
  bool starting_ = true;                      ///< only "starting" was reported so far
  std::optional<bool> run_;
  std::string model_;
  DeviceStatus reported_;
};

}  // namespace fxagent
