// Sends configs to a fleet in batches, and stops at the first batch that an agent refuses or does
// not answer. Pure: the caller publishes, passes on the messages and gives the time.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "agent/cli/fleet/fleet.h"
#include "agent/steady_time.h"

namespace fxagent {

/// A document for one agent, and its outcome.
struct Push {
  enum class Outcome : std::uint8_t {
    not_sent,  ///< its batch has not begun
    waits,     ///< sent, no answer yet
    accepted,
    refused,      ///< the agent rejected it or rolled it back
    not_allowed,  ///< the broker did not accept the message
    silent,       ///< no answer in time
    on_trial,     ///< the document is in force, and its trial was not over in time
    offline,      ///< the agent was not online when its batch began; nothing was sent
    left_out,     ///< the same, and the caller allows it
  };
  std::string agent;
  std::string document;
  std::string version;
  std::string hash;  ///< of the document
  Outcome outcome = Outcome::not_sent;
  std::vector<std::string> why{};  ///< of an outcome that is not `accepted`
  std::size_t reports_before = 0;  ///< FleetAgent::reports when it was sent

  bool is_decided() const { return outcome != Outcome::not_sent && outcome != Outcome::waits; }
  bool is_good() const { return outcome == Outcome::accepted || outcome == Outcome::left_out; }
};

struct RolloutRules {
  std::size_t batch = 1;  ///< agents at a time
  std::chrono::seconds patience{30};
  bool confirmed = false;     ///< a config counts as accepted only after its trial
  bool skip_offline = false;  ///< an agent that is offline does not stop the rollout
};

class Rollout final {
 public:
  Rollout(std::vector<Push> pushes, RolloutRules rules);

  /// Compares the batch with the fleet's reports and the time. Returns the agents whose documents
  /// are to be published now, as indexes in pushes(): those of the next batch, once each agent of
  /// the batch before has accepted its document.
  std::vector<std::size_t> advance(const Fleet& fleet, SteadyTime now);
  /// Ends the rollout before its time: the outcomes are those known so far.
  void end(const Fleet& fleet);
  /// Records that the broker did not accept the document of an agent.
  void not_accepted(std::size_t push, const std::string& why);

  /// True if nothing is left to publish or to wait for.
  bool is_over() const { return over_; }
  /// True if the answer of an agent is missing.
  bool waits() const;
  /// Returns the time at which the batch ends without the answers that are missing.
  SteadyTime deadline() const { return deadline_; }
  const std::vector<Push>& pushes() const { return pushes_; }
  /// True if each agent that was not left out has accepted its document, and there is one.
  bool is_good() const;
  /// Returns the number of the last batch that has begun, from 1.
  std::size_t batch() const { return (end_ + rules_.batch - 1) / rules_.batch; }
  /// Returns the index of its first agent.
  std::size_t begin() const { return begin_; }
  std::size_t batches() const { return (pushes_.size() + rules_.batch - 1) / rules_.batch; }

 private:
  void judge_batch(const Fleet& fleet, bool time_is_up);
  std::vector<std::size_t> begin_batch(const Fleet& fleet, SteadyTime now);

  std::vector<Push> pushes_;
  const RolloutRules rules_;
  std::size_t begin_ = 0;  ///< of the batch
  std::size_t end_ = 0;
  SteadyTime deadline_ = SteadyTime::max();
  bool over_ = false;
};

}  // namespace fxagent
