#include "agent/pair/announcements.h"

#include <algorithm>
#include <utility>

#include "agent/pair/pair_messages.h"

namespace fxagent {

void Announcements::add(AdmittedCommand command, const std::string& device, const Submit& submit) {
  if (command.command.op == Op::read) return submit(std::move(command));
  std::string text = pair_messages::announcement({.boot = boot_,
                                                  .id_is_number = command.command.id_is_number,
                                                  .entry = entry_of(command, device)});
  std::unique_lock lock(mutex_);
  const bool waits = !released_;
  if (waits) added_.push_back({std::move(command), std::move(text), submit});
  lock.unlock();
  waits ? wake_() : submit(std::move(command));
}

void Announcements::release() {
  {
    const std::lock_guard lock(mutex_);
    released_ = true;
  }
  wake_();
}

void Announcements::take_back(std::vector<std::uint32_t> devices, TakenBack done) {
  {
    const std::lock_guard lock(mutex_);
    requests_.push_back({std::move(devices), std::move(done)});
  }
  wake_();
}

void Announcements::step(std::size_t window, const Publish& publish, SteadyTime now) {
  std::vector<Request> requests;
  bool released = false;
  {
    const std::lock_guard lock(mutex_);
    released = released_;
    waiting_.splice(waiting_.end(), added_);
    requests.swap(requests_);
  }
  for (const Request& request : requests) {
    std::vector<AdmittedCommand> taken;
    std::erase_if(waiting_, [&](Waiting& each) {
      if (!std::ranges::count(request.devices, each.command.command.device)) return false;
      taken.push_back(std::move(each.command));
      return true;
    });
    request.done(std::move(taken));
  }
  std::erase_if(waiting_, [&](Waiting& each) {
    if (!released && !(each.is_refused && now > each.command.deadline)) return false;
    each.submit(std::move(each.command));
    return true;
  });
  // Those on their way precede those that are not published yet.
  for (Waiting& each : waiting_) {
    if (each.is_refused) continue;
    if (window-- == 0) return;
    if (each.publication == 0) each.publication = publish(std::move(each.text));
  }
}

std::list<Announcements::Waiting>::iterator Announcements::published(std::uint64_t id) {
  return std::ranges::find(waiting_, id, &Waiting::publication);
}

bool Announcements::delivered(std::uint64_t id) {
  const auto announced = published(id);
  if (announced == waiting_.end()) return false;
  announced->submit(std::move(announced->command));
  waiting_.erase(announced);
  return true;
}

void Announcements::refused(std::uint64_t id) {
  const auto announced = published(id);
  if (announced == waiting_.end()) return;
  announced->publication = 0;
  announced->is_refused = true;
}

}  // namespace fxagent
