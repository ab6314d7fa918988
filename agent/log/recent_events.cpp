#include "agent/log/recent_events.h"

#include <algorithm>
#include <atomic>
#include <deque>
#include <mutex>

#include "agent/steady_time.h"

namespace fxagent::log {
namespace {

std::atomic<bool> is_kept = false;

struct Kept {
  std::mutex mutex;
  std::deque<Event> events;
  std::size_t bytes = 0;
  std::uint64_t number = 0;
};

/// Never destroyed, because other threads may log to the end.
Kept& kept() {
  static Kept& instance = *new Kept;
  return instance;
}

}  // namespace

void keep_events() { is_kept = true; }

std::vector<Event> events_after(std::uint64_t number, std::size_t most) {
  Kept& all = kept();
  const std::lock_guard lock(all.mutex);
  auto first = std::ranges::upper_bound(all.events, number, {}, &Event::number);
  const auto count = static_cast<std::size_t>(all.events.end() - first);
  if (count > most) first += static_cast<std::ptrdiff_t>(count - most);
  return {first, all.events.end()};
}

void keep(Level level, std::string_view name, std::initializer_list<Field> fields) {
  if (level < Level::info || !is_kept.load(std::memory_order_relaxed)) return;
  std::string text = format_line("", fields);
  text.erase(0, 1);  // the blank behind the event's name
  const std::int64_t now = utc_now_ms();
  Kept& all = kept();
  const std::lock_guard lock(all.mutex);
  if (!all.events.empty()) {
    Event& last = all.events.back();
    if (last.level == level && last.name == name && last.text == text) {
      // A new number, so that readers of the last one see the count.
      last.number = ++all.number;
      last.ts_ms = now;
      ++last.count;
      return;
    }
  }
  all.bytes += text.size();
  all.events.push_back({++all.number, now, level, std::string(name), std::move(text)});
  while (all.events.size() > kMostEvents || all.bytes > kMostEventBytes) {
    all.bytes -= all.events.front().text.size();
    all.events.pop_front();
  }
}

}  // namespace fxagent::log
