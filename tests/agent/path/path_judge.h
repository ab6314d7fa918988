// Compares published results of commands with the actual writes of the devices.
#pragma once

#include <chrono>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "tests/agent/path/lasting_journal.h"
#include "tests/agent/path/ledger_device.h"
#include "tests/agent/path/random_commands.h"

namespace fxagent::test {

class PathJudge final {
 public:
  /// Records a message that the agent has received.
  void received(const SentCommand& sent);
  /// Records a published result.
  void published(std::uint32_t device, const std::string& text);
  /// Records that another agent has the same id now.
  void conflict_began() { conflicts_.push_back(std::chrono::steady_clock::now()); }
  /// Records that the agent of that life was killed.
  void killed(int life) { killed_.insert(life); }

  /// Returns all errors, one per line; empty: none.
  std::string judge_all(const std::vector<LedgerDevice*>& devices, const LastingJournal& journal,
                        const std::vector<std::string>& names);
  /// Returns all messages of one id, for an error text.
  std::string messages_of(std::uint32_t device, const std::string& id) const;

  std::map<std::string, int> counted;    ///< results by status, each once
  std::map<std::string, int> by_reason;  ///< the same by status and reason

 private:
  using Json = nlohmann::json;
  using Key = std::pair<std::uint32_t, std::string>;
  struct Known {
    std::vector<SentCommand> sent;
    std::vector<Json> results;  ///< without DUPLICATE
    SteadyTime published_at{};  ///< time of the first
    std::vector<Json> duplicates;
  };

  std::string judge(const Key& key, const Known& known, const LedgerDevice& device,
                    bool in_journal) const;
  std::string judge_results(const Known& known) const;
  void count(const Json& result);
  bool may_be_lost(const Known& known) const;
  std::string judge_unreadable() const;
  std::string judge_ledger(std::uint32_t index, const LedgerDevice& device) const;

  std::map<Key, Known> known_;
  std::set<int> killed_;
  std::vector<SteadyTime> conflicts_;  ///< their beginnings
  std::vector<SentCommand> unreadable_;
  int without_id_ = 0;  ///< number of results
};

}  // namespace fxagent::test
