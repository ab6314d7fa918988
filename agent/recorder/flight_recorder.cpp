#include "agent/recorder/flight_recorder.h"

#include <algorithm>
#include <utility>

#include "agent/log/log.h"
#include "agent/without_signals.h"

namespace fxagent {
namespace {

using Clock = std::chrono::steady_clock;

std::int64_t now_us() { return utc_us(std::chrono::system_clock::now()); }

}  // namespace

FlightRecorder::FlightRecorder(Settings settings)
    : settings_(std::move(settings)),
      files_(settings_.directory, settings_.most_files, settings_.most_bytes) {
  const WithoutSignals quiet;
  thread_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
}

std::shared_ptr<FrameRing> FlightRecorder::new_ring(const std::string& link, std::string wire,
                                                    std::size_t bytes) {
  auto ring = std::make_shared<FrameRing>(bytes);
  const std::lock_guard lock(mutex_);
  std::erase_if(links_, [](const auto& each) { return each.second.ring.expired(); });
  Link& place = links_[link];
  place.ring = ring;
  place.wire = std::move(wire);
  return ring;
}

std::shared_ptr<const FrameRing> FlightRecorder::ring_of(const std::string& link) const {
  const std::lock_guard lock(mutex_);
  const auto found = links_.find(link);
  return found == links_.end() ? nullptr : found->second.ring.lock();
}

void FlightRecorder::anomaly(const std::string& link, const std::string& reason) {
  const std::lock_guard lock(mutex_);
  const auto found = links_.find(link);
  if (found == links_.end()) return;
  if (const auto waiting = due_.find(link); waiting != due_.end()) {
    // Bounded: the first reasons explain the file.
    constexpr std::size_t kMostReason = 500;
    std::string& said = waiting->second.reason;
    if (said.size() < kMostReason && said.find(reason) == said.npos) said += "; " + reason;
    return;
  }
  const auto now = Clock::now();
  // More files at once would delete each other.
  if (now < found->second.rests_until || due_.size() >= settings_.most_files) {
    ++found->second.unwritten;
    return;
  }
  auto ring = found->second.ring.lock();
  if (!ring) return;
  found->second.rests_until = now + settings_.follows + settings_.rest;
  due_[link] = {std::move(ring), found->second.wire, now + settings_.follows, reason};
  wake_.notify_one();
}

void FlightRecorder::asked() {
  const std::lock_guard lock(mutex_);
  asked_ = true;
  wake_.notify_one();
}

void FlightRecorder::run(const std::stop_token& stop) {
  if (const std::string fault = files_.begin(); !fault.empty())
    log::error("recorder", {{"state", "no files"},
                            {"reason", fault},
                            {"note",
                             "the agent runs on and tries again at the next recording: "
                             "make the directory of recorder.path usable"}});
  std::unique_lock lock(mutex_);
  while (true) {
    const auto next =
        std::ranges::min_element(due_, {}, [](const auto& each) { return each.second.at; });
    if (std::exchange(asked_, false)) {
      lock.unlock();
      write_asked();
      lock.lock();
    } else if (next != due_.end() && (stop.stop_requested() || next->second.at <= Clock::now())) {
      const auto [link, due] = *next;
      due_.erase(next);
      std::string reason = due.reason;
      const auto place = links_.find(link);
      const std::size_t others =
          place == links_.end() ? 0 : std::exchange(place->second.unwritten, 0);
      if (others > 0) reason += "; " + std::to_string(others) + " more since the previous file";
      lock.unlock();
      write(link, *due.ring, due.wire, std::move(reason));
      lock.lock();
    } else if (stop.stop_requested()) {
      return;
    } else if (next != due_.end()) {
      // Later anomalies are due later.
      wake_.wait_until(lock, stop, SteadyTime(next->second.at), [this] { return asked_; });
    } else {
      wake_.wait(lock, stop, [this] { return asked_ || !due_.empty(); });
    }
  }
}

void FlightRecorder::write_asked() {
  const std::vector<std::string> names = files_.take_request();
  std::vector<std::pair<std::string, Link>> links;
  {
    const std::lock_guard lock(mutex_);
    for (const auto& each : links_)
      if (names.empty() || std::ranges::find(names, each.first) != names.end())
        links.emplace_back(each);
  }
  // Files of earlier links would be deleted again.
  if (links.size() > settings_.most_files) {
    log::warn("recorder", {{"asked", std::to_string(links.size())},
                           {"written", std::to_string(settings_.most_files)},
                           {"note", "recorder.files allows no more: raise it, or name the links"}});
    links.resize(settings_.most_files);
  }
  std::vector<std::string> paths;
  for (const auto& [name, link] : links)
    if (const auto ring = link.ring.lock())
      if (std::string path = write(name, *ring, link.wire, "asked"); !path.empty())
        paths.push_back(std::move(path));
  if (const std::string fault = files_.answer(now_us(), paths); !fault.empty())
    log::warn("recorder", {{"state", "not answered"}, {"reason", fault}});
}

/// Returns the path of the file; empty if there is none.
std::string FlightRecorder::write(const std::string& link, const FrameRing& ring,
                                  const std::string& wire, std::string reason) {
  const RecordedFrames frames = ring.frames();
  const RecordingHead head{.agent = settings_.agent,
                           .version = settings_.version,
                           .link = link,
                           .wire = wire,
                           .reason = std::move(reason),
                           .written_us = now_us()};
  std::string path;
  const std::string fault = files_.write(link, head.written_us, recording_text(head, frames), path);
  if (fault.empty())
    log::info("recorder", {{"link", link},
                           {"frames", std::to_string(frames.frames.size())},
                           {"file", path},
                           {"reason", head.reason}});
  else
    log::warn("recorder", {{"link", link}, {"state", "not written"}, {"reason", fault}});
  return path;
}

}  // namespace fxagent
