// Commands and results that the disk has not taken yet, in memory and bounded: one entry for each
// device and id, in the order in which they came and last changed. The store's thread.
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
  /// Above either the oldest results go, and then the oldest commands; the first time is logged.
  static constexpr std::size_t kMost = 10000;
  static constexpr std::size_t kMostBytes = std::size_t{8} << 20;

  /// As in the file, a result belongs to the command with its number, and a later command that uses
  /// the id anew takes its place.
  void put(JournalEntry entry);
  /// Null: it is not here. Until the next put() or drop_first().
  const JournalEntry* find(const std::string& device, const std::string& id) const;
  std::size_t size() const { return entries_.size(); }
  /// In their order.
  auto begin() const { return entries_.begin(); }
  auto end() const { return entries_.end(); }
  /// Lets the first `count` of them go: they are in the file.
  void drop_first(std::size_t count);
  /// The calendar was set by so much.
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
  bool forgot_some_ = false;  ///< since they were here last without any
};

}  // namespace fxagent
