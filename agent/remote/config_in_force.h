// The remote config in force and its trial. Pure.
#pragma once

#include <algorithm>
#include <chrono>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "agent/remote/kept_configs.h"
#include "agent/steady_time.h"

namespace fxagent {

/// The config in force. On trial, it is good if the agent is connected to the broker at the end of
/// the trial. It is lost if the broker is away for the length of a trial without a break.
class ConfigInForce final {
 public:
  enum class Outcome { pending, good, lost };

  /// `trial` is the length of a trial.
  explicit ConfigInForce(std::chrono::milliseconds trial) : trial_time_(trial) {}

  /// Returns nullopt if the local file alone is in force.
  const std::optional<KeptConfig>& document() const { return document_; }
  /// Returns the version of the document; empty if there is none.
  std::string version() const { return document_ ? document_->document.version : ""; }
  bool is_on_trial() const { return began_.has_value(); }
  std::chrono::milliseconds trial_time() const { return trial_time_; }

  /// Puts `document` in force and ends a trial. `servers` is mqtt.servers of the config.
  void put_in_force(std::optional<KeptConfig> document, std::vector<std::string> servers) {
    document_ = std::move(document);
    set_servers(std::move(servers));
    end_trial();
  }
  /// Puts `document` in force and begins its trial. If not connected, the broker counts as away
  /// since `now`.
  void put_on_trial(std::optional<KeptConfig> document, std::vector<std::string> servers,
                    SteadyTime now) {
    has_moved_ = servers != servers_;
    put_in_force(std::move(document), std::move(servers));
    began_ = now;
    if (away_since_) away_since_ = now;
  }
  void set_servers(std::vector<std::string> servers) { servers_ = std::move(servers); }
  /// True if the trial changes mqtt.servers and `servers` would change them once more.
  bool would_move_again(const std::vector<std::string>& servers) const {
    return began_ && has_moved_ && servers != servers_;
  }

  /// Call when the connection was made or lost at `now`. A repeated loss does not restart the time
  /// that the broker is away.
  void connection(bool is_up, SteadyTime now) {
    if (is_up)
      away_since_.reset();
    else if (!away_since_)
      away_since_ = now;
  }
  /// Ends the trial as lost, whatever its outcome.
  void give_up() { is_given_up_ = is_on_trial(); }
  bool is_given_up() const { return is_given_up_; }
  void end_trial() {
    began_.reset();
    is_given_up_ = false;
  }

  /// Returns the outcome of the trial; pending if there is none.
  Outcome outcome(SteadyTime now) const {
    if (!began_ || (!is_given_up_ && now < decided_at())) return Outcome::pending;
    if (!is_given_up_ && !away_since_) return Outcome::good;
    return now < put_off_until_ ? Outcome::pending : Outcome::lost;
  }
  /// Returns the time of the outcome, unless the connection changes before.
  SteadyTime next_wake() const {
    if (!began_) return SteadyTime::max();
    return std::max(is_given_up_ ? SteadyTime{} : decided_at(), put_off_until_);
  }
  /// Makes a lost trial pending until `time`.
  void put_off(SteadyTime time) { put_off_until_ = time; }

 private:
  SteadyTime decided_at() const { return away_since_.value_or(*began_) + trial_time_; }

  const std::chrono::milliseconds trial_time_;
  std::optional<KeptConfig> document_;
  std::optional<SteadyTime> began_;                      ///< start of the trial; nullopt: none
  std::optional<SteadyTime> away_since_ = SteadyTime{};  ///< nullopt: connected to the broker
  std::vector<std::string> servers_;                     ///< mqtt.servers in force
  bool has_moved_ = false;  ///< the config on trial changed mqtt.servers
  bool is_given_up_ = false;
  SteadyTime put_off_until_{};
};

}  // namespace fxagent
