#include "agent/uplink/commands/result_delivery.h"

#include <algorithm>
#include <utility>

#include "agent/commands/result.h"
#include "agent/failpoint.h"
#include "agent/log/log.h"
#include "agent/text/text.h"
#include "agent/uplink/topics.h"

namespace fxagent {
namespace {

// Limits for results that the broker has not acknowledged.
constexpr std::size_t kMostResults = 200;
constexpr std::size_t kMostResultBytes = std::size_t{8} << 20;
// Messages between a result and its PUBACK. A broker may send kReceiveMaximum ahead, and a few more
// of the messages let in if its PUBACK is slow. mosquitto 2.0.11 sends its whole queue once it has
// queued anything. With a Receive Maximum of 1 it does not.
constexpr std::uint64_t kFarAhead = 50 * kReceiveMaximum;
constexpr std::size_t kBurst = 2000;  // results that may wait: the commands have come already
constexpr std::uint64_t kFarAheadBytes = std::uint64_t{8} << 20;  // ten of the longest are 2 MiB
// Results and samples do not share a window smaller than this.
constexpr std::size_t kLeastShared = 4;

/// True if the config has a device or a link of this name.
bool has(const Config& config, const std::string& name) {
  return std::ranges::find(config.devices, name, &DeviceConfig::name) != config.devices.end() ||
         std::ranges::find(config.links, name, &LinkConfig::name) != config.links.end();
}

}  // namespace

ResultDelivery::ResultDelivery(const Config& config, CommandResults& results, Outgoing& outgoing,
                               JitteredBackoff& backoff, UtcClock utc_ms)
    : config_(config),
      source_(results),
      outgoing_(outgoing),
      backoff_(backoff),
      utc_ms_(std::move(utc_ms)) {}

void ResultDelivery::add(ResultMessage result, SteadyTime now) {
  if (result.reply) result.reply(with_total(result.text, now - result.received));
  result.reply = nullptr;
  const std::string& device = result.device;
  if (!is_name(device)) return;  // a profile or the page named what no device can be
  const std::string base = config_.base_topic();
  Pending pending;
  pending.copies.push_back({.topic = base + "/" + device + "/result"});
  // Up to 64 KiB of the sender's data: kept once.
  if (std::string topic = std::move(result.response_topic); !topic.empty()) {
    const std::string fault = response_topic_fault(topic, base, device);
    if (fault.empty())
      pending.copies.push_back({.topic = std::move(topic)});
    else
      log::warn("response_topic_ignored",
                {{"topic", log::excerpt(topic)}, {"id", result.id}, {"reason", fault}});
  }
  pending.bytes = sizeof(pending) + bytes_of(result) + pending.copies.back().topic.size();
  bytes_ += pending.bytes;
  pending.result = std::move(result);
  results_.emplace(next_++, std::move(pending));
}

bool ResultDelivery::is_full() const {
  return results_.size() >= kMostResults || bytes_ >= kMostResultBytes;
}

/// Returns how many results may be in flight at once. A quarter of the window is for states and
/// samples, however many results are waiting.
std::size_t ResultDelivery::window() const {
  const std::size_t whole = outgoing_.window();
  return whole >= kLeastShared ? whole - whole / 4 : whole;
}

bool ResultDelivery::pump(SteadyTime now, std::optional<Heard> heard) {
  bool sent = false;
  for (const auto& [key, pending] : results_) {
    for (std::size_t i = 0; i < pending.copies.size(); ++i) {
      const Copy& copy = pending.copies[i];
      if (copy.state != State::waiting || copy.not_before > now) continue;
      if (!outgoing_.has_room() || flights_.size() >= window())
        return sent && outgoing_.window() < kLeastShared;
      hand_over(key, i, now, heard);
      sent = true;
    }
  }
  return sent && outgoing_.window() < kLeastShared;
}

void ResultDelivery::hand_over(std::uint64_t key, std::size_t copy, SteadyTime now,
                               std::optional<Heard> heard) {
  Pending& pending = results_.at(key);
  ResultMessage& result = pending.result;
  if (!result.total && result.received != SteadyTime{}) {
    result.total = std::max(now - result.received, SteadyTime::duration::zero());
    if (result.sent) durations_.add(*result.total);
    result.text = with_total(std::move(result.text), *result.total);
    source_.note_total(result);
  }
  Copy& to = pending.copies[copy];
  to.state = State::in_flight;
  Publication publication{
      .topic = to.topic, .payload = result.text, .correlation = result.correlation};
  // If the result is too large for the broker with its correlation data, the device's own topic
  // gets it without.
  if (copy == 0 && !outgoing_.fits(publication)) publication.correlation.clear();
  flights_.emplace(outgoing_.send(*this, std::move(publication)), Flight{key, copy, heard});
  failpoint("result_published");
}

void ResultDelivery::connection_ended() {
  flights_.clear();
  for (auto& [key, pending] : results_) {
    for (Copy& copy : pending.copies) {
      if (copy.state == State::in_flight) copy.state = State::waiting;
      copy.not_before = {};
      copy.failures = 0;
      copy.refused = false;
    }
  }
}

void ResultDelivery::delivered(std::uint64_t id, SteadyTime) {
  failpoint("result_acknowledged");
  copy_done(flights_.extract(id).mapped(), State::acknowledged);
}

void ResultDelivery::failed(const DeliveryFailed& event, SteadyTime now) {
  const Flight flight = flights_.extract(event.id).mapped();
  Pending& pending = results_.at(flight.result);
  Copy& copy = pending.copies[flight.copy];
  log_failed("result", event, log::Field("topic", log::excerpt(copy.topic)),
             log::Field("id", pending.result.id));
  // The sender of the command chose the response topic: if the broker refuses it, there is no
  // retry.
  if (is_final(event.reason_code) || (flight.copy != 0 && event.reason_code != 0))
    return copy_done(flight, State::refused);
  copy.state = State::waiting;
  copy.refused = event.reason_code != 0;
  copy.not_before = now + backoff_.after(copy.failures++);
}

void ResultDelivery::copy_done(const Flight& flight, State how) {
  const auto found = results_.find(flight.result);
  auto& copies = found->second.copies;
  copies[flight.copy].state = how;
  const auto is_done = [](const Copy& each) { return each.state >= State::acknowledged; };
  if (!std::ranges::all_of(copies, is_done)) return;
  const bool has_arrived = copies.front().state == State::acknowledged;
  source_.note_delivery(found->second.result, has_arrived, utc_ms_());
  bytes_ -= found->second.bytes;
  results_.erase(found);
}

bool ResultDelivery::is_refused() const {
  return std::ranges::any_of(results_, [this](const auto& each) {
    const Pending& pending = each.second;
    const Copy& copy = pending.copies.front();
    return copy.refused && copy.state < State::acknowledged && has(config_, pending.result.device);
  });
}

bool ResultDelivery::is_far_behind(const Heard& heard) const {
  return std::ranges::any_of(flights_, [this, &heard](const auto& each) {
    const auto& then = each.second.heard;
    return then && ((heard.messages - then->messages >= kFarAhead && results_.size() >= kBurst) ||
                    heard.bytes - then->bytes >= kFarAheadBytes);
  });
}

SteadyTime ResultDelivery::next_wake(SteadyTime now) const {
  SteadyTime wake = SteadyTime::max();
  for (const auto& [key, pending] : results_)
    for (const Copy& copy : pending.copies)
      if (copy.not_before > now) wake = std::min(wake, copy.not_before);
  return wake;
}

}  // namespace fxagent
