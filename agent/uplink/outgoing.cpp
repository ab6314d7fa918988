#include "agent/uplink/outgoing.h"

#include <algorithm>
#include <utility>

#include "agent/log/log.h"
#include "agent/uplink/topics.h"

namespace fxagent {
namespace {

// Mosquitto's default Receive Maximum. The library is fast up to the broker's figure and very slow
// beyond it.
constexpr std::size_t kMaxWindow = 20;
// Bytes of a PUBLISH besides topic, payload and correlation data: header, lengths, packet id.
constexpr std::size_t kPacketOverhead = 64;

}  // namespace

void Outgoing::begin(const Connected& connected) {
  window_ = std::clamp<std::size_t>(connected.receive_maximum, 1, kMaxWindow);
  max_packet_ = connected.maximum_packet;
}

void Outgoing::forget() {
  flights_.clear();
  groups_.clear();
  waiting_.clear();
  marker_ = 0;
  last_unproven_ = 0;
  unanswered_since_.reset();
}

std::uint64_t Outgoing::send(Sender& sender, Publication publication) {
  const std::uint64_t id = publication.id = next_id_++;
  hand_over({&sender, publication.qos != 0}, std::move(publication));
  return id;
}

std::uint64_t Outgoing::send_group(Sender& sender, std::vector<Publication> publications) {
  if (publications.size() == 1) return send(sender, std::move(publications.front()));
  const std::uint64_t group = next_id_;
  groups_.emplace(group, Group{publications.size()});
  for (Publication& publication : publications) {
    publication.id = next_id_++;
    const Flight flight{&sender, publication.qos != 0, group};
    waiting_.push_back({flight, std::move(publication)});
  }
  send_waiting();
  return group;
}

void Outgoing::send_waiting() {
  while (!waiting_.empty() && flights_.size() < window_) {
    Waiting next = std::move(waiting_.front());
    waiting_.pop_front();
    hand_over(next.flight, std::move(next.publication));
  }
}

void Outgoing::hand_over(Flight flight, Publication publication) {
  flight.turn = ++turns_;
  if (!flight.expects_puback) last_unproven_ = flight.turn;
  flights_.emplace(publication.id, flight);
  // For either of these the broker would close the connection, again and again.
  if (!is_publishable(publication.topic)) {
    unsendable_.push_back(
        {publication.id, kTopicNameInvalid, "not a topic: " + log::excerpt(publication.topic)});
  } else if (!fits(publication)) {
    unsendable_.push_back({publication.id, kPacketTooLarge, "larger than the broker accepts"});
  } else {
    handed_over_ = true;
    broker_.publish(std::move(publication));
  }
}

bool Outgoing::fail_unsendable(SteadyTime now) {
  const auto failures = std::exchange(unsendable_, {});
  for (const DeliveryFailed& failure : failures) {
    const auto flight = flights_.extract(failure.id);
    if (!flight.empty()) ended(failure.id, flight.mapped(), &failure, now);
  }
  return !failures.empty();
}

void Outgoing::on(const Delivered& event, SteadyTime now) {
  if (event.id == marker_) return marked(now);
  const auto found = flights_.find(event.id);
  if (found == flights_.end()) return;  // from an earlier connection
  const Flight flight = found->second;
  if (!flight.expects_puback && !marker_topic_.empty()) return;  // the next marker will prove it
  flights_.erase(found);
  note_answer(flight, now);
  ended(event.id, flight, nullptr, now);
}

void Outgoing::on(const DeliveryFailed& event, SteadyTime now) {
  // A broker that refuses a marker has received it.
  if (event.id == marker_) {
    if (event.reason_code != 0) return marked(now);
    marker_ = marker_turn_ = 0;  // the next step tries again
    return;
  }
  const auto flight = flights_.extract(event.id);
  if (flight.empty()) return;
  if (event.reason_code != 0) note_answer(flight.mapped(), now);
  ended(event.id, flight.mapped(), &event, now);
}

/// Passes the outcome on to the sender; of a group when its last publication has ended.
void Outgoing::ended(std::uint64_t id, const Flight& flight, const DeliveryFailed* failure,
                     SteadyTime now) {
  std::optional<DeliveryFailed> of_group;
  if (flight.group != 0) {
    Group& group = groups_.at(flight.group);
    if (failure != nullptr)
      group.failure = DeliveryFailed{flight.group, failure->reason_code, failure->text};
    if (--group.open != 0) return send_waiting();
    id = flight.group;
    of_group = std::move(groups_.extract(id).mapped().failure);
    failure = of_group ? &*of_group : nullptr;
  }
  if (failure != nullptr)
    flight.sender->failed(*failure, now);
  else
    flight.sender->delivered(id, now);
  send_waiting();
}

/// The broker has everything that was sent before the marker.
void Outgoing::marked(SteadyTime now) {
  marker_ = 0;
  unanswered_since_ = now;
  std::vector<std::pair<std::uint64_t, Flight>> proven;
  for (const auto& [id, flight] : flights_)
    if (flight.turn < marker_turn_ && !flight.expects_puback) proven.emplace_back(id, flight);
  for (const auto& [id, flight] : proven) {
    flights_.erase(id);
    ended(id, flight, nullptr, now);
  }
  if (flights_.empty()) unanswered_since_.reset();
}

/// Records that the broker answers. A QoS 0 delivery shows that only if no PUBACK is outstanding.
void Outgoing::note_answer(const Flight& flight, SteadyTime now) {
  const auto owed = [](const auto& other) { return other.second.expects_puback; };
  if (!flight.expects_puback && std::ranges::any_of(flights_, owed)) return;
  unanswered_since_ = flights_.empty() ? std::nullopt : std::optional(now);
}

void Outgoing::note_sent(SteadyTime now) {
  if (!marker_topic_.empty() && marker_ == 0 && last_unproven_ > marker_turn_) {
    marker_ = next_id_++;
    marker_turn_ = ++turns_;
    broker_.publish({.id = marker_, .topic = marker_topic_});
  }
  if (std::exchange(handed_over_, false) && !unanswered_since_) unanswered_since_ = now;
}

bool Outgoing::fits(const Publication& publication) const {
  return publication.topic.size() + publication.payload.size() + publication.correlation.size() +
             kPacketOverhead <=
         max_packet_;
}

}  // namespace fxagent
