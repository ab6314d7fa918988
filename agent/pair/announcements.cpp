#include "agent/pair/announcements.h"

#include <algorithm>
#include <iterator>
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

void Announcements::take_back(std::vector<std::uint32_t> devices, TakenBack done) {
  const std::lock_guard lock(mutex_);
  requests_.push_back({std::move(devices), std::move(done)});
}

void Announcements::step(bool can_publish, const Publish& publish, SteadyTime now) {
  std::vector<Request> requests;
  bool released = false;
  {
    const std::lock_guard lock(mutex_);
    released = released_;
    std::ranges::move(std::exchange(added_, {}), std::back_inserter(waiting_));
    requests.swap(requests_);
  }
  for (const Request& each : requests) each.done(taken(each.devices));
  if (released) {
    for (auto& [id, each] : std::exchange(on_the_way_, {})) submit(each);
    for (Waiting& each : std::exchange(refused_, {})) submit(each);
    for (Waiting& each : std::exchange(waiting_, {})) submit(each);
    return;
  }
  std::erase_if(refused_, [&](Waiting& each) {
    if (now <= each.command.deadline) return false;
    submit(each);
    return true;
  });
  if (!can_publish) return;
  for (Waiting& each : std::exchange(waiting_, {})) {
    const std::uint64_t id = publish(each.text);
    on_the_way_.emplace(id, std::move(each));
  }
}

std::vector<AdmittedCommand> Announcements::taken(const std::vector<std::uint32_t>& devices) {
  std::vector<AdmittedCommand> out;
  const auto take = [&](Waiting& each) {
    if (std::ranges::find(devices, each.command.command.device) == devices.end()) return false;
    out.push_back(std::move(each.command));
    return true;
  };
  for (auto each = on_the_way_.begin(); each != on_the_way_.end();)
    each = take(each->second) ? on_the_way_.erase(each) : std::next(each);
  std::erase_if(refused_, take);
  std::erase_if(waiting_, take);
  return out;
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
