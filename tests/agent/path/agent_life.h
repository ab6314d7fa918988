// One life of an agent without its broker: commands as text in, results as text out, and all that
// lies between, on lines with a ledger at their end. Time is that of clock_by_hand.h.
#pragma once

#include <asio/io_context.hpp>
#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "agent/commands/commands.h"
#include "agent/config/config.h"
#include "agent/field/link_worker.h"
#include "agent/outbox.h"
#include "tests/agent/path/fate.h"
#include "tests/agent/path/lasting_journal.h"
#include "tests/agent/path/ledger_device.h"
#include "tests/agent/path/random_commands.h"

namespace fxagent::test {

/// UTC of the clock by hand.
std::int64_t path_utc_ms();

class AgentLife final {
 public:
  /// What the broker gets.
  using Publish = std::function<void(std::uint32_t device, const std::string& text)>;

  /// What the journal has of earlier lives is taken up. All arguments outlive it.
  AgentLife(const Config& config, LastingJournal& journal,
            const std::vector<LedgerDevice*>& devices, Fate& fate, Polling polling,
            Publish publish);
  /// Ends the field, whatever has become of the agent.
  ~AgentLife();

  void receive(const SentCommand& sent);
  /// Empty: nobody has the id of this one.
  void set_conflict(const std::string& other_boot) { commands_.set_conflict(other_boot); }
  /// Messages that came together: in the journal in one commit.
  void hand_over();
  /// Lets time pass.
  void run_for(std::chrono::milliseconds duration);
  /// Until every command has its result and the broker has all, or the agent has ended.
  void run_until_idle();
  /// A clean stop, which commands may still come into: `meanwhile` is called now and then.
  void stop(const std::function<void()>& meanwhile);

  /// Of ten results so many are never acknowledged in this life.
  int not_acknowledged = 0;

 private:
  struct InFlight {
    ResultMessage message;
    SteadyTime acknowledged_at;
  };
  void step(std::chrono::nanoseconds by);
  void take_outbox();
  void publish_results();
  void take_acknowledgements();
  void stop_links();
  bool has_ended() const { return ended_ == workers_.size(); }

  const Config& config_;
  Fate& fate_;
  Publish publish_;
  asio::io_context io_;
  Outbox outbox_{64};
  Commands commands_;
  std::vector<std::unique_ptr<LinkWorker>> workers_;
  std::vector<InFlight> in_flight_;
  std::size_t ended_ = 0;
  int with_field_ = 0;  ///< commands that it has and has not answered
};

}  // namespace fxagent::test
