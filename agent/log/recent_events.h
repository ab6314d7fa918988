// Keeps the newest log events in memory, for the timeline of the page. Keeps nothing until a reader
// asks for it. Any thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <string>
#include <string_view>
#include <vector>

#include "agent/log/log.h"

namespace fxagent::log {

/// One event, at least of level `info`, whatever level the log itself has.
struct Event {
  std::uint64_t number = 0;  ///< ascending; above 0
  std::int64_t ts_ms = 0;
  Level level = Level::info;
  std::string name;         ///< "device"
  std::string text;         ///< "device=press1 state=offline": the fields as in a text log
  std::uint64_t count = 1;  ///< equal events in a row count as one, with the time of the newest
};

/// Most events kept, and most bytes of their texts. The oldest go first.
inline constexpr std::size_t kMostEvents = 2000;
inline constexpr std::size_t kMostEventBytes = std::size_t{512} << 10;

/// Begins to keep events. They stay for the lifetime of the process.
void keep_events();
/// Returns the kept events with numbers above `number`, oldest first, at most `most`: the newest.
std::vector<Event> events_after(std::uint64_t number, std::size_t most);

/// Keeps an event if keep_events() was called. Called by the log.
void keep(Level level, std::string_view name, std::initializer_list<Field> fields);

}  // namespace fxagent::log
