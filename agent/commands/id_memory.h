// The command ids that a device has seen: the promise that no command is carried out twice. It
// stays in memory whatever becomes of the disk; the results, which only tell, are the journal's to
// keep.
//
// Of the newest ids everything is kept; what they push out is a fingerprint from then on, in room
// that all devices share. What was refused is kept apart: the newest kRememberedRefused have room
// of their own, more of them what the admitted ones leave. Pure: time is an argument.
#pragma once

#include <boost/multi_index/member.hpp>
#include <boost/multi_index/ordered_index.hpp>
#include <boost/multi_index_container.hpp>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "agent/commands/command_room.h"
#include "agent/commands/journal.h"
#include "agent/messages.h"

namespace fxagent {

class IdMemory final {
 public:
  struct Entry {
    std::string id;
    std::uint64_t number = 0;  ///< of its command: its age among the others
    SteadyTime seen{};
    SteadyTime deadline{};
    bool over = false;  ///< its command has a result
    /// That result, where nobody else keeps it.
    std::shared_ptr<const CommandResult> result{};
  };
  /// What is known of an id.
  struct Seen {
    bool over = false;
    std::optional<std::uint64_t> number;  ///< nullopt: only the fingerprint is left
    std::shared_ptr<const CommandResult> result{};
  };

  /// `room` is shared with the other devices; `device` is this one's name.
  IdMemory(std::shared_ptr<CommandRoom> room, std::string device)
      : room_(std::move(room)), device_(std::move(device)) {}

  /// Nothing: the id was never seen, or need not be known any more.
  std::optional<Seen> find(const std::string& id, SteadyTime now) const;
  /// Whether one more command may be remembered. Lets go of what is over and older than
  /// kRememberedFor; where kRememberedIds are held, the oldest that is over becomes a fingerprint,
  /// or, where there is no room for that, the oldest that is past its deadline goes.
  bool make_room(SteadyTime now);
  /// Remembers the id of a command, whether make_room() was asked or not. One that is known stays
  /// as it is.
  void add(Entry entry, SteadyTime now);
  /// The id of a command that was refused. The oldest of them make room.
  void add_refused(Entry entry, SteadyTime now);
  /// The command has its result. Nothing where the id is not known.
  void finish(const std::string& id, std::shared_ptr<const CommandResult> result);
  /// The result that is kept of this id, if it is, took so long until it was handed over.
  void note_total(const std::string& id, std::chrono::nanoseconds total);

  /// Whether no id is left, once what is over and older than kRememberedFor has gone. Fingerprints
  /// are the room's.
  bool is_empty(SteadyTime now) {
    forget_old(now);
    return size() == 0;
  }
  /// Fingerprints not counted.
  std::size_t size() const { return ids_ ? ids_->admitted.size() + ids_->refused.size() : 0; }

 private:
  // Both by order: a hash table of its own costs each device 432 bytes, whether it ever sees a
  // command or not.
  using Entries = boost::multi_index_container<
      Entry, boost::multi_index::indexed_by<
                 boost::multi_index::ordered_non_unique<
                     boost::multi_index::member<Entry, std::uint64_t, &Entry::number>>,
                 boost::multi_index::ordered_unique<
                     boost::multi_index::member<Entry, std::string, &Entry::id>>>>;

  struct Ids {
    Entries admitted;  ///< the oldest first; where numbers are the same, as they were added
    Entries refused;   ///< the same
  };

  Ids& ids();
  void forget_old(SteadyTime now);
  /// Whether the refused ids take more than is theirs.
  bool has_too_many_refused() const;

  std::shared_ptr<CommandRoom> room_;
  std::string device_;
  std::unique_ptr<Ids> ids_;  ///< null: there was none so far, as with most devices
};

}  // namespace fxagent
