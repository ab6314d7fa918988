#include "agent/pair/announcements.h"

#include <algorithm>
#include <utility>

namespace fxagent {

void Announcements::add(Waiting waiting) {
  {
    const std::lock_guard lock(mutex_);
    if (!released_) return added_.push_back(std::move(waiting));
  }
  waiting.submit(std::move(waiting.command));
}

void Announcements::release() {
  const std::lock_guard lock(mutex_);
  released_ = true;
}

void Announcements::take_back(std::vector<std::uint32_t> devices, TakenBack done) {
  const std::lock_guard lock(mutex_);
  requests_.push_back({std::move(devices), std::move(done)});
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
