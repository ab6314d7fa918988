#include "agent/commands/id_memory.h"

#include <algorithm>
#include <iterator>
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

std::optional<IdMemory::Seen> IdMemory::find(const std::string& id, SteadyTime now) const {
  for (const Entries* entries : {&admitted_, &refused_}) {
    const auto& by_id = entries->get<1>();
    const auto found = by_id.find(id);
    if (found != by_id.end() && !is_old(*found, now))
      return Seen{found->over, found->number, found->result};
  }
  if (room_->fingerprints.has(device_, id, now)) return Seen{true, std::nullopt, nullptr};
  return std::nullopt;
}

void IdMemory::forget_old(SteadyTime now) {
  for (auto entry = admitted_.begin(); entry != admitted_.end();) {
    if (entry->over && !is_old(*entry, now)) break;
    entry = entry->over ? admitted_.erase(entry) : std::next(entry);
  }
  while (!refused_.empty() && is_old(*refused_.begin(), now)) refused_.erase(refused_.begin());
}

bool IdMemory::make_room(SteadyTime now) {
  forget_old(now);
  if (admitted_.size() < kRememberedIds) return true;
  const auto is_over = [](const Entry& entry) { return entry.over; };
  const bool room = room_->fingerprints.make_room(now);
  const auto oldest = room ? std::find_if(admitted_.begin(), admitted_.end(), is_over)
                           : std::find_if(admitted_.begin(), admitted_.end(),
                                          [now](const Entry& e) { return may_go(e, now); });
  if (oldest == admitted_.end()) return false;
  if (room) room_->fingerprints.add(device_, oldest->id, oldest->seen, oldest->deadline);
  admitted_.erase(oldest);
  return true;
}

void IdMemory::add(Entry entry, SteadyTime now) {
  auto& by_id = admitted_.get<1>();
  const auto found = by_id.find(entry.id);
  if (found != by_id.end() && is_old(*found, now)) by_id.erase(found);
  refused_.get<1>().erase(entry.id);
  admitted_.insert(std::move(entry));
  // What was refused makes way; what an earlier run leaves may be more than is kept whole.
  while (has_too_many_refused()) refused_.erase(refused_.begin());
  while (admitted_.size() > kRememberedIds) {
    const auto oldest = std::find_if(admitted_.begin(), admitted_.end(),
                                     [](const Entry& each) { return each.over; });
    if (oldest == admitted_.end()) break;
    room_->fingerprints.add(device_, oldest->id, oldest->seen, oldest->deadline);
    admitted_.erase(oldest);
  }
}

bool IdMemory::has_too_many_refused() const {
  return refused_.size() > kRememberedRefused && size() > kRememberedIds;
}

void IdMemory::add_refused(Entry entry, SteadyTime now) {
  forget_old(now);
  refused_.get<1>().erase(entry.id);
  refused_.insert(std::move(entry));
  while (has_too_many_refused()) refused_.erase(refused_.begin());
}

void IdMemory::finish(const std::string& id, std::shared_ptr<const CommandResult> result) {
  auto& by_id = admitted_.get<1>();
  const auto found = by_id.find(id);
  if (found == by_id.end()) return;
  by_id.modify(found, [&](Entry& entry) {
    entry.over = true;
    entry.result = std::move(result);
  });
}

void IdMemory::note_total(const std::string& id, std::chrono::nanoseconds total) {
  for (Entries* entries : {&admitted_, &refused_}) {
    auto& by_id = entries->get<1>();
    const auto found = by_id.find(id);
    if (found == by_id.end() || !found->result) continue;
    CommandResult result = *found->result;
    result.total = total;
    by_id.modify(found, [&](Entry& entry) {
      entry.result = std::make_shared<const CommandResult>(std::move(result));
    });
  }
}

}  // namespace fxagent
