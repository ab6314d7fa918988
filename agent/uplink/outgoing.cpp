#include "agent/uplink/outgoing.h"

#include <algorithm>
#include <utility>

#include "agent/log/log.h"
#include "agent/uplink/puback.h"
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
  unanswered_since_.reset();
}

std::uint64_t Outgoing::send(Sender& sender, Publication publication) {
  const std::uint64_t id = publication.id = next_id_++;
  flights_.emplace(id, Flight{&sender, publication.qos != 0});
  // For either of these the broker would close the connection, again and again.
  if (!is_publishable(publication.topic)) {
    unsendable_.push_back(
        {id, kTopicNameInvalid, "not a topic: " + log::excerpt(publication.topic)});
  } else if (!fits(publication)) {
    unsendable_.push_back({id, kPacketTooLarge, "larger than the broker accepts"});
  } else {
    handed_over_ = true;
    broker_.publish(std::move(publication));
  }
  return id;
}

bool Outgoing::fail_unsendable(SteadyTime now) {
  const auto failures = std::exchange(unsendable_, {});
  for (const DeliveryFailed& failure : failures) {
    const auto flight = flights_.extract(failure.id);
    if (!flight.empty()) flight.mapped().sender->failed(failure, now);
  }
  return !failures.empty();
}

void Outgoing::on(const Delivered& event, SteadyTime now) {
  const auto flight = flights_.extract(event.id);
  if (flight.empty()) return;  // from an earlier connection
  note_answer(flight.mapped(), now);
  flight.mapped().sender->delivered(event.id, now);
}

void Outgoing::on(const DeliveryFailed& event, SteadyTime now) {
  const auto flight = flights_.extract(event.id);
  if (flight.empty()) return;
  if (event.reason_code != 0) note_answer(flight.mapped(), now);
  flight.mapped().sender->failed(event, now);
}

/// Records that the broker answers. A QoS 0 delivery shows that only if no PUBACK is outstanding.
void Outgoing::note_answer(const Flight& flight, SteadyTime now) {
  const auto owed = [](const auto& other) { return other.second.expects_puback; };
  if (!flight.expects_puback && std::ranges::any_of(flights_, owed)) return;
  unanswered_since_ = flights_.empty() ? std::nullopt : std::optional(now);
}

void Outgoing::note_sent(SteadyTime now) {
  if (std::exchange(handed_over_, false) && !unanswered_since_) unanswered_since_ = now;
}

bool Outgoing::fits(const Publication& publication) const {
  return publication.topic.size() + publication.payload.size() + publication.correlation.size() +
             kPacketOverhead <=
         max_packet_;
}

}  // namespace fxagent
