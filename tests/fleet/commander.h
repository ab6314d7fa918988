// A client that sends commands to the players and counts their results. Repeats a command, with the
// same id, until its result has arrived. Time is an argument.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "tests/fleet/connection.h"
#include "tests/fleet/figures.h"
#include "tests/fleet/player.h"

namespace fxfleet {

class Commander final {
 public:
  /// All references outlive the commander. `per_second`: 0 sends none.
  Commander(asio::io_context& io, const Plan& plan, std::vector<std::unique_ptr<Player>>& players,
            double per_second);

  /// Does what is due. Call every few milliseconds.
  void step(Time now);
  /// Sends no new commands; repeats go on.
  void stop() { sends_ = false; }
  void leave();
  /// True if each command has a result.
  bool is_done() const { return pending_.empty(); }

  std::uint64_t sent() const { return number_; }
  std::uint64_t repeated() const { return repeated_; }
  /// Commands with a result.
  std::uint64_t answered() const { return number_ - pending_.size(); }
  /// Results of a command that already had one, except those with status DUPLICATE.
  std::uint64_t second_results() const { return second_results_; }
  const Durations& times() const { return times_; }

 private:
  struct Pending {
    Player* player;
    Time first;
    Time last;
    bool repeated = false;
  };

  void opened();
  void received(const Packet& packet);
  void result(std::string_view payload);
  void send(const std::string& id, Pending& pending, Time now);

  const Plan& plan_;
  std::vector<std::unique_ptr<Player>>& players_;
  const double per_second_;
  Connection connection_;
  std::minstd_rand random_{1};
  bool is_subscribed_ = false;
  bool is_open_ = false;
  bool sends_ = true;
  Time retry_at_{};
  Time next_at_{};
  Time heard_at_{};
  std::uint16_t last_id_ = 1;
  std::uint64_t number_ = 0;
  std::uint64_t repeated_ = 0;
  std::uint64_t second_results_ = 0;
  std::map<std::string, Pending> pending_;
  Durations times_;
};

}  // namespace fxfleet
