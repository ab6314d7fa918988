#include "agent/log/log_repeats.h"

namespace fxagent::log {

bool LogRepeats::take(Time now, int level, std::string_view text) {
  auto found = seen_.find(text);
  if (found == seen_.end()) {
    if (seen_.size() >= kMostTexts)
      std::erase_if(seen_, [&](const auto& entry) {
        return entry.second.until <= now && entry.second.count <= kWritten;
      });
    if (seen_.size() >= kMostTexts) return true;
    found = seen_.emplace(text, Seen{now + kWhile, level, 0}).first;
  }
  Seen& seen = found->second;
  // A period that is over and has a count to report ends with over().
  if (seen.until <= now && seen.count <= kWritten) seen = {now + kWhile, level, 0};
  return ++seen.count <= kWritten;
}

std::vector<LogRepeats::Repeated> LogRepeats::over(Time now) {
  std::vector<Repeated> told;
  std::erase_if(seen_, [&](const auto& entry) {
    const auto& [text, seen] = entry;
    if (seen.until > now) return false;
    if (seen.count > kWritten) told.push_back({seen.level, text, seen.count - kWritten});
    return true;
  });
  return told;
}

}  // namespace fxagent::log
