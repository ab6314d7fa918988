// Commands and results that the disk has not accepted yet, in memory and bounded. One entry per
// device and id, in the order in which they came or last changed. One thread at a time.
#pragma once

#include <boost/multi_index/composite_key.hpp>
#include <boost/multi_index/member.hpp>
#include <boost/multi_index/ordered_index.hpp>
#include <boost/multi_index/sequenced_index.hpp>
#include <boost/multi_index_container.hpp>
#include <cstddef>
#include <cstdint>
#include <string>

#include "agent/commands/journal.h"

namespace fxagent {

class UnrecordedCommands final {
 public:
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
  /// Shifts all times, after the calendar was set.
  void move_times(std::int64_t by_ms);

 private:
  void make_room();

  boost::multi_index_container<
      JournalEntry,
      boost::multi_index::indexed_by<
          boost::multi_index::sequenced<>,
          boost::multi_index::ordered_unique<boost::multi_index::composite_key<
              JournalEntry,
              boost::multi_index::member<JournalEntry, std::string, &JournalEntry::device>,
              boost::multi_index::member<JournalEntry, std::string, &JournalEntry::id>>>>>
      entries_;
  std::size_t bytes_ = 0;
  bool forgot_some_ = false;  ///< entries were dropped since this was last empty
};

}  // namespace fxagent
