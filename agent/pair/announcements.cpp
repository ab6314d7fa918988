#include "agent/pair/announcements.h"

#include <utility>

namespace fxagent {
namespace {

void submit(Announcements::Waiting& waiting) { waiting.submit(std::move(waiting.command)); }

}  // namespace

void Announcements::add(Waiting waiting) {
  {
    const std::lock_guard lock(mutex_);
    if (!released_) return added_.push_back(std::move(waiting));
  }
  submit(waiting);
}

void Announcements::release() {
  const std::lock_guard lock(mutex_);
  released_ = true;
}

void Announcements::step(bool can_publish, const Publish& publish, SteadyTime now) {
  std::vector<Waiting> added;
  bool released = false;
  {
    const std::lock_guard lock(mutex_);
    released = released_;
    if (released || can_publish) added.swap(added_);
  }
  if (released) {
    for (auto& [id, each] : std::exchange(on_the_way_, {})) submit(each);
    for (Waiting& each : std::exchange(refused_, {})) submit(each);
    for (Waiting& each : added) submit(each);
    return;
  }
  std::erase_if(refused_, [&](Waiting& each) {
    if (now <= each.command.deadline) return false;
    submit(each);
    return true;
  });
  for (Waiting& each : added) {
    const std::uint64_t id = publish(each.text);
    on_the_way_.emplace(id, std::move(each));
  }
}

bool Announcements::delivered(std::uint64_t id) {
  auto announced = on_the_way_.extract(id);
  if (announced.empty()) return false;
  submit(announced.mapped());
  return true;
}

void Announcements::refused(std::uint64_t id) {
  if (auto announced = on_the_way_.extract(id)) refused_.push_back(std::move(announced.mapped()));
}

}  // namespace fxagent
