#include "agent/field/id_memory.h"

#include <algorithm>
#include <utility>

namespace fxagent {
namespace {

bool may_go(const IdMemory::Entry& entry, SteadyTime now) {
  return entry.over && now > entry.deadline;
}

bool is_old(const IdMemory::Entry& entry, SteadyTime now) {
  return may_go(entry, now) && now - entry.seen >= kRememberedFor;
}

}  // namespace

const IdMemory::Entry* IdMemory::find(const std::string& id, SteadyTime now) const {
  const auto& by_id = entries_.get<1>();
  const auto found = by_id.find(id);
  return found == by_id.end() || is_old(*found, now) ? nullptr : &*found;
}

bool IdMemory::make_room(SteadyTime now) {
  while (!entries_.empty() && is_old(*entries_.begin(), now)) entries_.erase(entries_.begin());
  auto oldest = entries_.begin();
  while (entries_.size() >= kRememberedIds) {
    oldest = std::find_if(oldest, entries_.end(),
                          [now](const Entry& entry) { return may_go(entry, now); });
    if (oldest == entries_.end()) return false;
    oldest = entries_.erase(oldest);
  }
  return true;
}

void IdMemory::add(Entry entry, SteadyTime now) {
  auto& by_id = entries_.get<1>();
  const auto found = by_id.find(entry.id);
  if (found != by_id.end() && is_old(*found, now)) by_id.erase(found);
  entries_.insert(std::move(entry));
}

void IdMemory::finish(const std::string& id, std::shared_ptr<const CommandResult> result) {
  auto& by_id = entries_.get<1>();
  const auto found = by_id.find(id);
  if (found == by_id.end()) return;
  by_id.modify(found, [&](Entry& entry) {
    entry.over = true;
    entry.result = std::move(result);
  });
}

}  // namespace fxagent
