// Texts that the gateways of a pair exchange below {base}/pair. Pure. Any thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "agent/commands/journal.h"
#include "agent/pair/pair_state.h"

namespace fxagent::pair_messages {

/// Longest text in bytes; longer ones are ignored.
inline constexpr std::size_t kLongestText = 262144;

/// Topic of a member: "{base}/pair/{member}", and "/heartbeat" and "/journal" below it.
std::string topic_of(const std::string& base, const std::string& member);

/// A topic below {base}/pair.
struct Place {
  std::string member;
  std::string leaf;  ///< empty, "heartbeat" or "journal"
};
/// Returns nullopt for a topic that is not one of a pair.
std::optional<Place> place_of(std::string_view topic, const std::string& base);

/// `role` "offline" needs `member`, `boot` and `quiet` alone.
std::string status(const PairStatus& status);
/// Leaves out what is for people.
std::optional<PairStatus> status_from(std::string_view text);

struct Heartbeat {
  std::string boot;
  std::uint64_t seq = 0;  ///< no sequence number above it has been used
};
std::string heartbeat(const Heartbeat& heartbeat, std::uint64_t number);
std::optional<Heartbeat> heartbeat_from(std::string_view text);

/// A command that the holder is about to carry out, or a mark in the stream of them.
struct Announcement {
  std::string boot{};
  std::uint64_t mark = 0;   ///< not 0: a mark, without an entry
  bool unanswered = false;  ///< its process has ended, and its gateway knows no published result
  bool answered = false;    ///< the reply to that: the result is published
  bool id_is_number = false;
  JournalEntry entry{};  ///< as heard, its payload has nothing but an id that is a number
};
std::string announcement(const Announcement& announcement);
std::optional<Announcement> announcement_from(std::string_view text);

/// A published result, as far as the journal needs it.
struct Result {
  std::string id;
  std::string op;
  std::string status;
};
std::optional<Result> result_from(std::string_view text);

}  // namespace fxagent::pair_messages
