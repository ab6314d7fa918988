// Commands on their way in, no faster than they can be answered, and results on their way out.
#include <algorithm>
#include <utility>

#include "agent/commands/commands.h"
#include "agent/commands/result_text.h"
#include "agent/failpoint.h"
#include "agent/log/log.h"
#include "agent/uplink/puback.h"
#include "agent/uplink/publisher.h"
#include "agent/uplink/topics.h"

namespace fxagent {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr std::size_t kCommandsAStep = 32;  // samples and results go out in between
// What has come and has no decision yet. Above it messages stay in the network.
constexpr std::size_t kMostUndecided = 256;
constexpr std::size_t kMostUndecidedBytes = std::size_t{4} << 20;
// What has a result that the broker does not have yet.
constexpr std::size_t kMostResults = 200;
constexpr std::size_t kMostResultBytes = std::size_t{8} << 20;
// Acknowledgements come behind the messages that are held back, so that some of them are let in.
constexpr milliseconds kLetInEvery{2};
constexpr std::size_t kLetIn = 8;  // fewer than results that go out meanwhile
// Messages between a result and its PUBACK, where kReceiveMaximum may be sent ahead. A broker that
// is slow with the PUBACK lets some more come meanwhile, of those that are let in.
constexpr std::uint64_t kFarAhead = 50 * kReceiveMaximum;
constexpr std::uint64_t kFarAheadBytes = std::uint64_t{8} << 20;  // ten of the longest are 2 MiB

}  // namespace

/// Commands are looked at a few at a time. What was published with QoS 0 comes as fast as the
/// broker can send; where there is no room for it, it is lost, as MQTT allows. With QoS 1 the
/// broker waits.
void Publisher::note_incoming(const Message& event, std::uint32_t device) {
  const bool full = incoming_.size() >= kMostUndecided || incoming_bytes_ >= kMostUndecidedBytes ||
                    results_.size() >= kMostResults || result_bytes_ >= kMostResultBytes;
  if (event.qos == 0 && full) {
    ++unasked_dropped_;
    return;
  }
  incoming_bytes_ += bytes_of(event);
  incoming_.emplace_back(event, device);
}

void Publisher::take_incoming(SteadyTime now) {
  if (outbox_.refuses_commands()) commands_.close();
  for (std::size_t i = 0; i < kCommandsAStep && !incoming_.empty(); ++i) {
    auto [message, device] = std::move(incoming_.front());
    incoming_.pop_front();
    incoming_bytes_ -= bytes_of(message);
    // An empty retained payload only clears the topic. On 3.1.1 its flag does not reach us.
    if (message.payload.empty() && (message.retained || config_.mqtt.version != 5)) continue;
    MessageProperties& properties = message;
    commands_.receive(device, message.topic, message.payload, std::move(properties), now,
                      utc_ms_());
  }
  commands_.hand_over();
}

/// So the agent reads no faster than it can answer. What waits for a decision gets one without the
/// broker; what waits for an acknowledgement needs what comes behind the messages.
void Publisher::hold_messages(SteadyTime now) {
  if (unasked_dropped_ != 0 && now >= drop_logged_at_ + kLogDropsEvery) {
    log::error("messages_dropped",
               {{"count", std::to_string(std::exchange(unasked_dropped_, 0))},
                {"note",
                 "more commands came with QoS 0 than can be answered; with QoS 1 the "
                 "broker waits"}});
    drop_logged_at_ = now;
  }
  const bool undecided =
      incoming_.size() >= kMostUndecided || incoming_bytes_ >= kMostUndecidedBytes;
  const bool unanswered = results_.size() >= kMostResults || result_bytes_ >= kMostResultBytes;
  holding_ = link_ == Link::connected && phase_ == Phase::running && (undecided || unanswered);
  if (holding_ && result_bytes_ >= settings_.result_bytes && !paused_) stop_listening(now);
  // A SUBACK or PUBACKs.
  const bool answers_are_due = suback_by_ || (!undecided && !flights_.empty());
  lets_in_ = holding_ && answers_are_due;
  if (!lets_in_) return broker_.hold_messages(holding_);
  if (now < let_in_at_) return;
  let_in_at_ = now + kLetInEvery;
  broker_.hold_messages(true, kLetIn);
}

/// Whether more has come since this result went than a broker sends that keeps to the Receive
/// Maximum. mosquitto 2.0.11 sends all that its queue holds, 1,000 messages, once it was full; with
/// a Receive Maximum of 1 it does not.
bool Publisher::is_far_behind(const Flight& flight) const {
  const auto* result = std::get_if<ResultFlight>(&flight);
  return result != nullptr && result->heard &&
         (heard_.messages - result->heard->messages >= kFarAhead ||
          heard_.bytes - result->heard->bytes >= kFarAheadBytes);
}

bool Publisher::broker_runs_ahead() const {
  return holding_ && receive_maximum_ > 1 && config_.mqtt.version == 5 &&
         std::ranges::any_of(flights_,
                             [this](const auto& each) { return is_far_behind(each.second); });
}

/// So many results may be on their way at once: a quarter of the window is for states and samples,
/// however many results wait.
std::size_t Publisher::result_window() const {
  return window_ >= 4 ? window_ - window_ / 4 : window_;
}

void Publisher::delivered(const ResultFlight& flight, SteadyTime) {
  failpoint("result_acknowledged");
  result_copy_done(flight.result, flight.copy, Ended::acknowledged);
}

void Publisher::failed(const ResultFlight& flight, const DeliveryFailed& event, SteadyTime now) {
  const auto found = results_.find(flight.result);
  if (found == results_.end()) return;
  PendingResult::Copy& copy = found->second.copies[flight.copy];
  log::warn("publish_refused", {{"what", "result"},
                                {"topic", log::excerpt(copy.topic)},
                                {"id", found->second.result.id},
                                {"code", hex_code(event.reason_code)},
                                {"reason", event.text}});
  // A response topic is the sender's choice: where the broker refuses it, that is that.
  if (is_final(event.reason_code) || (copy.to_response_topic && event.reason_code != 0))
    return result_copy_done(flight.result, flight.copy, Ended::refused);
  copy.in_flight = false;
  copy.due = Due{now + back_off(copy.due.failures), copy.due.failures + 1};
  refused_results_.insert(flight.result);
}

void Publisher::take_result(ResultMessage result) {
  PendingResult pending;
  pending.copies.push_back({.topic = device_topic(result.device) + "/result"});
  if (!result.response_topic.empty()) {
    const std::string fault = response_topic_fault(result.response_topic, config_.root, base_,
                                                   config_.devices.at(result.device).name);
    if (fault.empty())
      pending.copies.push_back({.topic = result.response_topic, .to_response_topic = true});
    else
      log::warn(
          "response_topic_ignored",
          {{"topic", log::excerpt(result.response_topic)}, {"id", result.id}, {"reason", fault}});
    result.response_topic = {};  // the copy has it
  }
  pending.bytes = sizeof(pending) + bytes_of(result) + pending.copies.back().topic.size();
  result_bytes_ += pending.bytes;
  pending.result = std::move(result);
  results_.emplace(next_result_++, std::move(pending));
}

void Publisher::pump_results(SteadyTime now) {
  auto results_on_their_way =
      static_cast<std::size_t>(std::ranges::count_if(flights_, [](const auto& each) {
        return std::holds_alternative<ResultFlight>(each.second);
      }));
  for (auto& [key, pending] : results_) {
    for (std::size_t i = 0; i < pending.copies.size(); ++i) {
      PendingResult::Copy& copy = pending.copies[i];
      if (copy.in_flight || copy.done || copy.due.not_before > now) continue;
      if (!has_room() || results_on_their_way >= result_window()) return;
      ResultMessage& result = pending.result;
      if (!std::exchange(pending.handed_over, true) && !result.recorded)
        result.text = with_total(std::move(result.text), now - result.received);
      copy.in_flight = true;
      Publication publication;
      publication.topic = copy.topic;
      publication.payload = result.text;
      publication.correlation = result.correlation;
      // The device's own topic gets the result even where the broker does not take it with its
      // echo.
      if (!copy.to_response_topic && !fits(publication)) publication.correlation.clear();
      samples_first_ = result_window() == window_;
      send(ResultFlight{key, i, holding_ ? std::optional(heard_) : std::nullopt},
           std::move(publication));
      ++results_on_their_way;
      failpoint("result_published");
    }
  }
}

void Publisher::result_copy_done(std::uint64_t result, std::size_t copy, Ended how) {
  const auto found = results_.find(result);
  if (found == results_.end()) return;
  auto& copies = found->second.copies;
  copies[copy].done = true;
  copies[copy].acknowledged = how == Ended::acknowledged;
  if (!std::all_of(copies.begin(), copies.end(), [](const auto& each) { return each.done; }))
    return;
  commands_.note_delivery(found->second.result, copies.front().acknowledged, utc_ms_());
  result_bytes_ -= found->second.bytes;
  refused_results_.erase(found->first);
  results_.erase(found);
}

}  // namespace fxagent
