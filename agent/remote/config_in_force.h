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

/// Trial of a remote config. The config is good if the agent is connected to the broker at the end
/// of the trial. It is lost if the broker is away for the length of a trial without a break.
class Trial final {
 public:
  enum class Outcome { pending, good, lost };

  /// If not connected, the broker counts as away since `began`.
  Trial(std::chrono::milliseconds length, SteadyTime began, bool is_connected)
      : length_(length), began_(began) {
    if (!is_connected) away_since_ = began;
  }

  /// Call when the connection was made or lost at `now`. A repeated loss does not restart the time
  /// that the broker is away.
  void connection(bool is_connected, SteadyTime now) {
    if (is_connected)
      away_since_.reset();
    else if (!away_since_)
      away_since_ = now;
  }

  Outcome outcome(SteadyTime now) const {
    if (now < decided_at()) return Outcome::pending;
    return away_since_ ? Outcome::lost : Outcome::good;
  }

  /// Returns the time of the outcome, unless the connection changes before.
  SteadyTime decided_at() const { return away_since_.value_or(began_) + length_; }

 private:
  const std::chrono::milliseconds length_;
  const SteadyTime began_;
  std::optional<SteadyTime> away_since_;
};

class ConfigInForce final {
 public:
  /// `trial` is the length of a trial.
  explicit ConfigInForce(std::chrono::milliseconds trial) : trial_time_(trial) {}

  /// Returns nullopt if the local file alone is in force.
  const std::optional<KeptConfig>& document() const { return document_; }
  /// Returns the version of the document; empty if there is none.
  std::string version() const { return document_ ? document_->document.version : ""; }
  bool is_on_trial() const { return trial_.has_value(); }
  std::chrono::milliseconds trial_time() const { return trial_time_; }

  /// Puts `document` in force and ends the trial, if there is one. `servers` is mqtt.servers of
  /// the config.
  void put_in_force(std::optional<KeptConfig> document, std::vector<std::string> servers) {
    document_ = std::move(document);
    set_servers(std::move(servers));
    end_trial();
  }
  /// Puts `document` in force and begins its trial.
  void put_on_trial(std::optional<KeptConfig> document, std::vector<std::string> servers,
                    SteadyTime now) {
    has_moved_ = servers != servers_;
    put_in_force(std::move(document), std::move(servers));
    trial_.emplace(trial_time_, now, is_connected_);
  }
  void set_servers(std::vector<std::string> servers) { servers_ = std::move(servers); }
  /// True if the trial changes mqtt.servers and `servers` would change them once more.
  bool would_move_again(const std::vector<std::string>& servers) const {
    return trial_ && has_moved_ && servers != servers_;
  }

  void connection(bool is_up, SteadyTime now) {
    is_connected_ = is_up;
    if (trial_) trial_->connection(is_up, now);
  }
  /// Ends the trial as lost, whatever its outcome.
  void give_up() { is_given_up_ = is_on_trial(); }
  bool is_given_up() const { return is_given_up_; }
  void end_trial() {
    trial_.reset();
    is_given_up_ = false;
  }

  /// Returns the outcome of the trial; pending if there is none.
  Trial::Outcome outcome(SteadyTime now) const {
    if (!trial_) return Trial::Outcome::pending;
    const auto outcome = is_given_up_ ? Trial::Outcome::lost : trial_->outcome(now);
    if (outcome == Trial::Outcome::lost && now < put_off_until_) return Trial::Outcome::pending;
    return outcome;
  }
  /// Returns the time of the outcome, unless the connection changes before.
  SteadyTime next_wake() const {
    if (!trial_) return SteadyTime::max();
    return std::max(is_given_up_ ? SteadyTime{} : trial_->decided_at(), put_off_until_);
  }
  /// Makes a lost trial pending until `time`.
  void put_off(SteadyTime time) { put_off_until_ = time; }

 private:
  const std::chrono::milliseconds trial_time_;
  std::optional<KeptConfig> document_;
  std::optional<Trial> trial_;
  std::vector<std::string> servers_;  ///< mqtt.servers in force
  bool has_moved_ = false;            ///< the config on trial changed mqtt.servers
  bool is_given_up_ = false;
  SteadyTime put_off_until_{};
  bool is_connected_ = false;
};

}  // namespace fxagent
