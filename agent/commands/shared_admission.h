// Limits and state that the admission of all devices shares: bytes of pending commands,
// fingerprints of old ids, and reasons to admit no command. Pure: time is an argument.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <string>
#include <string_view>
#include <unordered_map>
#include <utility>

#include "agent/commands/journal.h"
#include "agent/steady_time.h"

namespace fxagent {

/// Fingerprints of ids whose commands have their results. Two ids with the same fingerprint count
/// as one. The key is secret, so no sender can search for such a pair. By chance a new id has a
/// known fingerprint once in 10^14, with 200,000 of them.
class IdFingerprints final {
 public:
  using Key = std::array<std::uint64_t, 2>;  ///< 128 bits
  /// Creates a random key.
  explicit IdFingerprints(std::size_t most = kFingerprints);
  ~IdFingerprints();
  IdFingerprints& operator=(IdFingerprints&&) noexcept;

  bool has(std::string_view device, std::string_view id, SteadyTime now) const;
  /// Returns true if one more may be kept. Removes old ones; when full, removes the oldest that is
  /// past its deadline.
  bool make_room(SteadyTime now);
  void add(std::string_view device, std::string_view id, SteadyTime seen, SteadyTime deadline);

  std::size_t size() const;

 private:
  struct All;

  std::uint64_t print_of(std::string_view device, std::string_view id) const;

  std::size_t most_;
  Key key_;
  std::unique_ptr<All> all_;                          ///< oldest first
  SteadyTime earliest_deadline_ = SteadyTime::max();  ///< no entry is past its own before this
};

/// Shared by the admission of all devices and by each command that has a place here.
class SharedAdmission final : public std::enable_shared_from_this<SharedAdmission> {
 public:
  /// Limit for all pending commands, and the share that each device has in any case.
  static constexpr std::size_t kMostBytes = std::size_t{8} << 20;
  static constexpr std::size_t kBytesOfADevice = std::size_t{64} << 10;

  /// Bytes reserved for one command until the last copy of this ends.
  using Place = std::shared_ptr<const void>;
  /// Reserves bytes for a command. Returns null if there is no room.
  Place take(std::uint32_t device, std::size_t bytes);
  std::size_t bytes() const { return bytes_; }

  /// Limit for the first results that are kept without a journal.
  static constexpr std::size_t kMostResultBytes = std::size_t{8} << 20;
  enum class ResultOf { refused, admitted };
  /// Keeps the text of a first result until newer ones need its room. Those of refused commands
  /// make room first, and take none from admitted ones.
  std::weak_ptr<std::string> keep(std::string result, ResultOf command);
  /// Approximate bytes of the kept results.
  std::size_t result_bytes() const { return result_bytes_; }

  IdFingerprints fingerprints;
  bool is_journaled = false;  ///< the journal keeps first results
  bool is_stopping = false;   ///< the agent is: what would be admitted is rejected
  /// Boot of another agent that has our id; empty: there is none. With one, what would be admitted
  /// is rejected.
  std::string conflict;

 private:
  std::size_t bytes_ = 0;
  std::unordered_map<std::uint32_t, std::size_t> by_device_;
  std::size_t result_bytes_ = 0;
  using Results = std::deque<std::pair<std::shared_ptr<std::string>, std::size_t>>;
  Results results_;          ///< of admitted commands, oldest first
  Results refused_results_;  ///< of refused ones
};

}  // namespace fxagent
