// The command ids that a device has seen, so that no command is carried out twice. They stay in
// memory, whatever happens to the disk. Results are for information only; the journal keeps them.
//
// The newest ids are kept whole. Older ones become fingerprints, in room that all devices share.
// Refused ids are kept apart: the newest kRememberedRefused have room of their own, further ones
// use what admitted ids leave free. Pure: time is an argument.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "agent/commands/journal.h"
#include "agent/commands/shared_admission.h"
#include "agent/steady_time.h"

namespace fxagent {

class IdMemory final {
 public:
  struct Entry {
    std::string id;
    std::uint64_t number = 0;  ///< of its command; the lower, the older
    SteadyTime seen{};
    SteadyTime deadline{};
    bool over = false;  ///< its command has a result
    /// Text of the result, unless a journal keeps it. SharedAdmission owns it and may discard it.
    std::weak_ptr<std::string> result{};
  };
  /// State of an id that was seen.
  struct Seen {
    bool over = false;
    std::optional<std::uint64_t> number;  ///< nullopt: only the fingerprint is left
    std::shared_ptr<const std::string> result{};
  };

  /// `shared` is common to all devices; `device` is the name of this one.
  IdMemory(std::shared_ptr<SharedAdmission> shared, std::string device);
  ~IdMemory();

  /// Returns nullopt if the id was never seen, or need not be known any more.
  std::optional<Seen> find(const std::string& id, SteadyTime now) const;
  /// Returns true if one more command may be remembered. Removes ids that are over and older than
  /// kRememberedFor. If kRememberedIds are held, the oldest that is over becomes a fingerprint. If
  /// there is no room for that, removes the oldest that is over and past its deadline.
  bool make_room(SteadyTime now);
  /// Remembers the id of a command, even without make_room(). An id that is known stays as it is.
  void add(Entry entry, SteadyTime now);
  /// Remembers the id of a refused command. The oldest refused ids make room.
  void add_refused(Entry entry, SteadyTime now);
  /// Records the result of a command. Does nothing if the id is not known.
  void finish(const std::string& id, std::weak_ptr<std::string> result);

  /// Removes ids that are over and older than kRememberedFor. Returns true if none is left;
  /// fingerprints are shared and do not count.
  bool is_empty(SteadyTime now);
  /// Number of ids, without fingerprints.
  std::size_t size() const;

 private:
  struct Ids;

  Ids& ids();
  void forget_old(SteadyTime now);
  /// True if refused ids take more than their share.
  bool has_too_many_refused() const;

  std::shared_ptr<SharedAdmission> shared_;
  std::string device_;
  std::unique_ptr<Ids> ids_;  ///< null: none so far, as with most devices
};

}  // namespace fxagent
