// The command ids that a device has seen: the promise that no order is carried out twice. It stays
// in memory whatever becomes of the disk; the results, which only tell, are the journal's to keep.
// Pure: time is an argument. Field thread.
#pragma once

#include <boost/multi_index/hashed_index.hpp>
#include <boost/multi_index/member.hpp>
#include <boost/multi_index/ordered_index.hpp>
#include <boost/multi_index_container.hpp>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>

#include "agent/messages.h"

namespace fxagent {

class IdMemory final {
 public:
  struct Entry {
    std::string id;
    std::uint64_t arrival = 0;  ///< of its command: its age among the others
    SteadyTime seen{};
    SteadyTime deadline{};
    bool over = false;  ///< its command has a result
    /// That result, where nobody else keeps it.
    std::shared_ptr<const CommandResult> result{};
  };

  /// Null: the id was never seen, or need not be known any more. Valid until the next change.
  const Entry* find(const std::string& id, SteadyTime now) const;
  /// Whether one more may be kept. Lets go of what is over and older than kRememberedFor, and,
  /// where kRememberedIds are held, of the oldest that are over and past their deadlines.
  bool make_room(SteadyTime now);
  /// An id that is known already stays as it is.
  void add(Entry entry, SteadyTime now);
  /// The command has its result. Nothing where the id is not known.
  void finish(const std::string& id, std::shared_ptr<const CommandResult> result);

  std::size_t size() const { return entries_.size(); }

 private:
  using Entries = boost::multi_index_container<
      Entry, boost::multi_index::indexed_by<
                 boost::multi_index::ordered_non_unique<
                     boost::multi_index::member<Entry, std::uint64_t, &Entry::arrival>>,
                 boost::multi_index::hashed_unique<
                     boost::multi_index::member<Entry, std::string, &Entry::id>>>>;

  Entries entries_;  ///< the oldest first; where arrivals are the same, as they were added
};

}  // namespace fxagent
