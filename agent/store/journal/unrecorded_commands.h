// Commands and results that the disk has not accepted yet, in memory and bounded. One entry per
// device and id, in the order in which they came or last changed. One thread at a time.
#pragma once

#include <cstddef>
#include <cstdint>
#include <list>
#include <map>
#include <string>
#include <utility>

#include "agent/commands/journal.h"

namespace fxagent {

class UnrecordedCommands final {
 public:
  UnrecordedCommands() = default;
  UnrecordedCommands(UnrecordedCommands&&) = default;
  UnrecordedCommands& operator=(UnrecordedCommands&&) = default;

  /// Above either limit, drops the oldest results, then the oldest commands. Logs the first drop.
  static constexpr std::size_t kMost = 10000;
  static constexpr std::size_t kMostBytes = std::size_t{8} << 20;

  /// Adds an entry by the rules of the file: a result belongs to the command with its number, and a
  /// later command with the same id replaces an earlier one.
  void put(JournalEntry entry);
  /// Returns null if there is no such entry. Valid until the next put() or drop_first().
  const JournalEntry* find(const std::string& device, const std::string& id) const;
  std::size_t size() const { return entries_.size(); }
  /// Iterates in that order.
  auto begin() const { return entries_.begin(); }
  auto end() const { return entries_.end(); }
  /// Removes the first `count` entries: they are in the file.
  void drop_first(std::size_t count);
  /// Shifts times by a calendar that was set: of commands with numbers from `from_number`, or that
  /// came at `from_ms` or later.
  void move_times(std::int64_t by_ms, std::uint64_t from_number, std::int64_t from_ms);

 private:
  using Entries = std::list<JournalEntry>;

  void make_room();
  void erase(Entries::iterator entry);

  Entries entries_;
  std::map<std::pair<std::string, std::string>, Entries::iterator> by_id_;  ///< device and id
  std::size_t bytes_ = 0;
  bool forgot_some_ = false;  ///< entries were dropped since this was last empty
};

}  // namespace fxagent
