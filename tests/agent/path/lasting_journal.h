// A journal that outlives the agents of a test. An agent may end in it, just before or just after
// an entry is kept.
#pragma once

#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "agent/commands/journal.h"
#include "tests/agent/path/fate.h"

namespace fxagent::test {

class LastingJournal final : public CommandJournal, private CommandStarts {
 public:
  explicit LastingJournal(Fate& fate) : fate_(fate) {}

  bool has(const std::string& device, const std::string& id) const {
    return entries_.contains({device, id});
  }

  std::uint64_t next_command_number() override { return ++last_number_; }
  void note(std::string) override {}
  bool journal(std::span<const JournalEntry> commands) override {
    if (fate_.ends_here("before the journal")) return true;
    for (const JournalEntry& entry : commands) entries_[{entry.device, entry.id}] = entry;
    fate_.ends_here("behind the journal");
    return true;
  }
  using CommandJournal::record;
  void record(std::vector<JournalEntry> given) override {
    if (fate_.ends_here("before the result is in the journal")) return;
    for (JournalEntry& entry : given) keep_result(std::move(entry));
    fate_.ends_here("behind the result in the journal");
  }
  void acknowledge(std::string device, std::string id, std::uint64_t number, std::string) override {
    if (fate_.ends_here("before the acknowledgement is noted")) return;
    const auto known = entries_.find({device, id});
    if (known != entries_.end() && known->second.number == number)
      known->second.acknowledged = true;
    fate_.ends_here("behind the acknowledgement");
  }
  CommandStarts* starts() override { return this; }
  std::optional<JournalEntry> find(const std::string& device, const std::string& id) override {
    const auto known = entries_.find({device, id});
    return known == entries_.end() ? std::nullopt : std::optional(known->second);
  }
  std::vector<KnownId> known_ids(const std::string& device) override {
    std::vector<KnownId> out;
    for (const JournalEntry& entry : oldest_first())
      if (!entry.result.empty() && is_of(entry, device))
        out.push_back({entry.device, entry.id, entry.number, entry.received_ms, entry.deadline_ms,
                       entry.refused});
    return out;
  }
  std::vector<JournalEntry> unacknowledged(const std::string& device) override {
    std::vector<JournalEntry> out = oldest_first();
    std::erase_if(out, [&](const JournalEntry& entry) {
      return entry.acknowledged || !is_of(entry, device);
    });
    for (JournalEntry& entry : out)
      entry.surely_not_sent = entry.result.empty() && !started_.contains(entry.number);
    return out;
  }

 private:
  static bool is_of(const JournalEntry& entry, const std::string& device) {
    return device.empty() || entry.device == device;
  }
  void mark(std::uint64_t number, Done done) override {
    if (!fate_.has_ended()) started_.insert(number);
    done(true);
  }
  void keep_result(JournalEntry entry) {
    JournalEntry& kept = entries_[{entry.device, entry.id}];
    if (kept.number != entry.number) kept = entry;
    if (!kept.result.empty()) return;
    kept.result = std::move(entry.result);
    kept.refused = entry.refused;
    kept.payload.clear();
  }
  std::vector<JournalEntry> oldest_first() const {
    std::vector<JournalEntry> out;
    for (const auto& [key, entry] : entries_) out.push_back(entry);
    std::sort(out.begin(), out.end(),
              [](const auto& left, const auto& right) { return left.number < right.number; });
    return out;
  }

  Fate& fate_;
  std::map<std::pair<std::string, std::string>, JournalEntry> entries_;
  std::set<std::uint64_t> started_;  ///< numbers of the commands that may have been sent
  std::uint64_t last_number_ = 0;
};

}  // namespace fxagent::test
