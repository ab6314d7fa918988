#include "agent/commands/id_memory.h"

#include <algorithm>
#include <boost/multi_index/member.hpp>
#include <boost/multi_index/ordered_index.hpp>
#include <boost/multi_index_container.hpp>
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

// Both indexes are ordered: a hash table costs each device 432 bytes, even if it never sees a
// command.
using Entries = boost::multi_index_container<
    IdMemory::Entry,
    boost::multi_index::indexed_by<
        boost::multi_index::ordered_non_unique<
            boost::multi_index::member<IdMemory::Entry, std::uint64_t, &IdMemory::Entry::number>>,
        boost::multi_index::ordered_unique<
            boost::multi_index::member<IdMemory::Entry, std::string, &IdMemory::Entry::id>>>>;

}  // namespace

struct IdMemory::Ids {
  Entries admitted;  ///< oldest first; equal numbers as they were added
  Entries refused;   ///< same
};

IdMemory::IdMemory(std::shared_ptr<SharedAdmission> shared, std::string device)
    : shared_(std::move(shared)), device_(std::move(device)) {}
IdMemory::~IdMemory() = default;

bool IdMemory::is_empty(SteadyTime now) {
  forget_old(now);
  return size() == 0;
}

std::size_t IdMemory::size() const {
  return ids_ ? ids_->admitted.size() + ids_->refused.size() : 0;
}

IdMemory::Ids& IdMemory::ids() {
  if (ids_ == nullptr) ids_ = std::make_unique<Ids>();
  return *ids_;
}

std::optional<IdMemory::Seen> IdMemory::find(const std::string& id, SteadyTime now) const {
  if (ids_ != nullptr) {
    for (const Entries* entries : {&ids_->admitted, &ids_->refused}) {
      const auto& by_id = entries->get<1>();
      const auto found = by_id.find(id);
      if (found != by_id.end() && !is_old(*found, now))
        return Seen{found->over, found->number, found->result.lock()};
    }
  }
  if (shared_->fingerprints.has(device_, id, now)) return Seen{true, std::nullopt, nullptr};
  return std::nullopt;
}

void IdMemory::forget_old(SteadyTime now) {
  if (ids_ == nullptr) return;
  auto& [admitted, refused] = *ids_;
  for (auto entry = admitted.begin(); entry != admitted.end();) {
    if (entry->over && !is_old(*entry, now)) break;
    entry = entry->over ? admitted.erase(entry) : std::next(entry);
  }
  while (!refused.empty() && is_old(*refused.begin(), now)) refused.erase(refused.begin());
}

bool IdMemory::make_room(SteadyTime now) {
  forget_old(now);
  if (ids_ == nullptr || ids_->admitted.size() < kRememberedIds) return true;
  Entries& admitted = ids_->admitted;
  const bool room = shared_->fingerprints.make_room(now);
  const auto oldest = std::find_if(admitted.begin(), admitted.end(), [&](const Entry& entry) {
    return room ? entry.over : may_go(entry, now);
  });
  if (oldest == admitted.end()) return false;
  if (room) shared_->fingerprints.add(device_, oldest->id, oldest->seen, oldest->deadline);
  admitted.erase(oldest);
  return true;
}

void IdMemory::add(Entry entry, SteadyTime now) {
  auto& [admitted, refused] = ids();
  auto& by_id = admitted.get<1>();
  const auto found = by_id.find(entry.id);
  if (found != by_id.end() && is_old(*found, now)) by_id.erase(found);
  refused.get<1>().erase(entry.id);
  admitted.insert(std::move(entry));
  // Refused ids make room. An earlier run may leave more admitted ids than are kept whole.
  while (has_too_many_refused()) refused.erase(refused.begin());
  while (admitted.size() > kRememberedIds) {
    const auto oldest =
        std::find_if(admitted.begin(), admitted.end(), [](const Entry& each) { return each.over; });
    if (oldest == admitted.end()) break;
    shared_->fingerprints.add(device_, oldest->id, oldest->seen, oldest->deadline);
    admitted.erase(oldest);
  }
}

bool IdMemory::has_too_many_refused() const {
  return ids_ != nullptr && ids_->refused.size() > kRememberedRefused && size() > kRememberedIds;
}

void IdMemory::add_refused(Entry entry, SteadyTime now) {
  forget_old(now);
  Entries& refused = ids().refused;
  refused.get<1>().erase(entry.id);
  refused.insert(std::move(entry));
  while (has_too_many_refused()) refused.erase(refused.begin());
}

void IdMemory::finish(const std::string& id, std::weak_ptr<std::string> result) {
  if (ids_ == nullptr) return;
  auto& by_id = ids_->admitted.get<1>();
  const auto found = by_id.find(id);
  if (found == by_id.end()) return;
  by_id.modify(found, [&](Entry& entry) {
    entry.over = true;
    entry.result = std::move(result);
  });
}

}  // namespace fxagent
