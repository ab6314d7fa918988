#include "agent/log/recent_events.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <deque>
#include <mutex>

#include "agent/steady_time.h"

namespace fxagent::log {
namespace {

std::atomic<bool> is_kept = false;

class Kept final {
 public:
  void add(Level level, std::string_view name, std::string text) {
    const std::int64_t now = utc_now_ms();
    const std::lock_guard lock(mutex_);
    if (!events_.empty()) {
      Event& last = events_.back();
      if (last.level == level && last.name == name && last.text == text) {
        // A new number, so that readers of the last one see the count.
        last.number = ++number_;
        last.ts_ms = now;
        ++last.count;
        return;
      }
    }
    bytes_ += text.size();
    events_.push_back({++number_, now, level, std::string(name), std::move(text)});
    while (events_.size() > kMostEvents || bytes_ > kMostEventBytes) {
      bytes_ -= events_.front().text.size();
      events_.pop_front();
    }
  }

  std::vector<Event> after(std::uint64_t number, std::size_t most) {
    const std::lock_guard lock(mutex_);
    auto first = std::ranges::upper_bound(events_, number, {}, &Event::number);
    const auto count = static_cast<std::size_t>(events_.end() - first);
    if (count > most) first += static_cast<std::ptrdiff_t>(count - most);
    return {first, events_.end()};
  }

 private:
  std::mutex mutex_;
  std::deque<Event> events_;
  std::size_t bytes_ = 0;
  std::uint64_t number_ = 0;
};

/// Never destroyed, because other threads may log to the end.
Kept& kept() {
  static Kept& instance = *new Kept;
  return instance;
}

}  // namespace

void keep_events() { is_kept = true; }

std::vector<Event> events_after(std::uint64_t number, std::size_t most) {
  return kept().after(number, most);
}

void keep(Level level, std::string_view name, std::span<const Field> fields) {
  if (level < Level::info || !is_kept.load(std::memory_order_relaxed)) return;
  std::string text;
  for (const Field& field : fields) {
    // Without the event's name and the blank behind it.
    const std::string line = format_line("", {field});
    text += text.empty() ? line.substr(1) : line;
  }
  kept().add(level, name, std::move(text));
}

}  // namespace fxagent::log
