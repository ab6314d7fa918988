// The command ids that a device has seen: the promise that no order is carried out twice. It stays
// in memory whatever becomes of the disk; the results, which only tell, are the journal's to keep.
// Pure: time is an argument. Field thread.
#pragma once

#include <boost/multi_index/hashed_index.hpp>
#include <boost/multi_index/member.hpp>
#include <boost/multi_index/sequenced_index.hpp>
#include <boost/multi_index_container.hpp>
#include <chrono>
#include <cstddef>
#include <memory>
#include <string>

#include "agent/messages.h"

namespace fxagent {

class IdMemory final {
 public:
  static constexpr std::size_t kMost = 10000;
  static constexpr std::chrono::hours kFor{24};  ///< and longer, up to the deadline

  struct Entry {
    std::string id;
    SteadyTime seen{};
    SteadyTime deadline{};
    bool over = false;  ///< its command has a result
    /// That result, where nobody else keeps it.
    std::shared_ptr<const CommandResult> result{};
  };

  /// Null: the id was never seen, or was let go. Valid until the next change.
  const Entry* find(const std::string& id) const;
  /// Whether one more may be kept. Lets go of what is over and older than kFor, and, where kMost
  /// are held, of the oldest that is over and past its deadline.
  bool make_room(SteadyTime now);
  /// The newest. An id that is known already stays as it is.
  void add(Entry entry);
  /// The command has its result. Nothing where the id is not known.
  void finish(const std::string& id, std::shared_ptr<const CommandResult> result);

  std::size_t size() const { return entries_.size(); }

 private:
  using Entries = boost::multi_index_container<
      Entry,
      boost::multi_index::indexed_by<boost::multi_index::sequenced<>,
                                     boost::multi_index::hashed_unique<boost::multi_index::member<
                                         Entry, std::string, &Entry::id>>>>;

  Entries entries_;  ///< the oldest first
};

}  // namespace fxagent
