// One life of an agent without its broker: commands as text in, results as text out, and everything
// in between. Its lines end at devices with a ledger. The clock is that of clock_by_hand.h.
#pragma once

#include <asio/io_context.hpp>
#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "agent/commands/commands.h"
#include "agent/config/model.h"
#include "agent/field/link/link_worker.h"
#include "agent/handover/outbox.h"
#include "tests/agent/path/fate.h"
#include "tests/agent/path/lasting_journal.h"
#include "tests/agent/path/ledger_device.h"
#include "tests/agent/path/random_commands.h"

namespace fxagent::test {

/// The manually set clock in UTC.
std::int64_t path_utc_ms();

class AgentLife final {
 public:
  /// Receives what would go to the broker.
  using Publish = std::function<void(std::uint32_t device, const std::string& text)>;

  /// Recovers the journal entries of earlier lives. All arguments must outlive this.
  AgentLife(const Config& config, LastingJournal& journal,
            const std::vector<LedgerDevice*>& devices, Fate& fate, Polling polling,
            Publish publish);
  /// Ends the field, in whatever state the agent is.
  ~AgentLife();

  void receive(const SentCommand& sent);
  /// An empty text means that no other agent has this id.
  void set_conflict(const std::string& other_boot) {
    commands_.set_conflict(other_boot);
    outbox_.set_conflict(!other_boot.empty());
  }
  /// Delivers messages that arrived together: one journal commit.
  void hand_over();
  /// Advances the time.
  void run_for(std::chrono::milliseconds duration);
  /// Runs until every command has its result and the broker has received all, or the agent has
  /// ended.
  void run_until_idle();
  /// Stops cleanly. Calls `meanwhile` from time to time; it may deliver further commands.
  void stop(const std::function<void()>& meanwhile);

  /// This many of ten results are never acknowledged in this life.
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
  int with_field_ = 0;  ///< commands at the field without a result
};

}  // namespace fxagent::test
