// Runs the players through the phases of a measurement: connect, steady load, storm after a kill of
// the broker, steady load, settle. One thread.
#pragma once

#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "tests/fleet/broker_process.h"
#include "tests/fleet/commander.h"
#include "tests/fleet/figures.h"
#include "tests/fleet/player.h"

namespace fxfleet {

struct FleetOptions {
  Plan plan;
  unsigned agents = 1000;
  /// Connections under way at a time while the fleet connects for the first time.
  unsigned at_once = 100;
  double seconds = 10;             ///< of steady load in all
  std::optional<double> storm_at;  ///< s after the fleet has connected; none: no storm
  double down_s = 5;               ///< from the kill to the restart
  double patience_s = 300;         ///< for each phase without a given time
  double commands_per_second = 10;
  std::string broker_command;  ///< empty: the broker is not ours
  std::string broker_log;
  std::string storm_command;  ///< instead of kill and restart; for sh, in the background
};

class Fleet final {
 public:
  explicit Fleet(FleetOptions options);

  /// Runs all phases and returns the figures. `complete` is false in them if a phase ran out of
  /// patience.
  nlohmann::ordered_json run();

 private:
  enum class Phase : std::uint8_t { broker, connect, steady, storm, after, settle, done };
  /// Counters at the beginning of a phase.
  struct Mark {
    Time at;
    std::uint64_t published = 0, received = 0;
    double broker_cpu = 0, own_cpu = 0;
  };

  void tick();
  void step(Time now);
  void connect_some(Time now);
  void begin(Phase phase, Time now);
  void begin_storm(Time now);
  void storm(Time now);
  void wake(unsigned number);
  bool is_answering() const;
  Mark mark(Time now) const;
  nlohmann::ordered_json steady_report(Time now);
  nlohmann::ordered_json storm_report(Time now);
  nlohmann::ordered_json totals() const;

  const FleetOptions options_;
  asio::io_context io_;
  asio::steady_timer ticks_{io_};
  std::optional<BrokerProcess> broker_;
  std::optional<BrokerProcess> storm_command_;
  Figures figures_;
  std::vector<std::unique_ptr<Player>> players_;
  std::vector<std::unique_ptr<asio::steady_timer>> timers_;
  Commander commander_;
  nlohmann::ordered_json report_;

  Phase phase_ = Phase::broker;
  Time phase_at_{};
  Mark mark_;
  long empty_broker_kib_ = 0;
  std::size_t started_ = 0;
  bool gave_up_ = false;

  // The storm.
  Figures before_;
  Time killed_at_{};
  std::optional<Time> restarted_at_;
  std::size_t fewest_ = 0;  ///< connected players
  std::optional<double> half_back_s_;
  std::optional<double> nearly_back_s_;  ///< 99 %
  std::optional<double> all_back_s_;
};

}  // namespace fxfleet
