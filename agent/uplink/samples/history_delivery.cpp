#include "agent/uplink/samples/history_delivery.h"

#include <algorithm>
#include <chrono>
#include <string>
#include <utility>

#include "agent/failpoint.h"
#include "agent/log/log.h"

namespace fxagent {
namespace {

// Number of history messages in flight, each of a different stream: the broker gets a stream's next
// message when it has acknowledged the one before.
constexpr std::size_t kHistoryFlights = 2;
// After each history message, history pauses for half of the time that the message took, so that
// live samples and commands regularly find the broker free. kLongestRest limits the pause on slow
// networks.
constexpr int kRestShare = 2;
constexpr std::chrono::milliseconds kLongestRest{100};
// Rows that cannot be delivered any more are dropped one batch at a time: reading a large backlog
// at once would hold up everything else.
constexpr std::chrono::milliseconds kBetweenDrops{1};
// A quarter of the allowed size: a message of 64 KiB delays a live sample by milliseconds.
constexpr std::size_t kHistoryBytes = 16384;

}  // namespace

HistoryDelivery::HistoryDelivery(SamplePayload& payload, Outgoing& outgoing,
                                 RefusedDevices& refused, WaitingSamples& waiting)
    : payload_(payload),
      outgoing_(outgoing),
      refused_(refused),
      waiting_(waiting),
      max_bytes_(kHistoryBytes) {}

/// A small window has one place for history; the rest is for live samples and results.
bool HistoryDelivery::has_room() const {
  const std::size_t most = outgoing_.is_small() ? 1 : kHistoryFlights;
  return flights_.size() < most && outgoing_.has_room_for_samples();
}

void HistoryDelivery::pump(bool rests, SteadyTime now) {
  if (rests && now < rests_until_) return;
  while (has_room()) {
    auto history = waiting_.next(payload_, max_bytes_, [&](const std::string& device) {
      return refused_.may_send(device, now) && payload_.may_send(device);
    });
    if (!history) return;
    if (history->publications.empty()) {
      waiting_.remove(*history, SampleEnd::refused);
      rests_until_ = now + kBetweenDrops;
      return;
    }
    published_ += history->batch.row_ids.size();
    const std::uint64_t id = outgoing_.send_group(*this, std::exchange(history->publications, {}));
    flights_.emplace(id, Flight{std::move(*history), max_bytes_, now});
  }
}

void HistoryDelivery::connection_began() { max_bytes_ = kHistoryBytes; }

void HistoryDelivery::connection_ended() {
  for (const auto& [id, flight] : std::exchange(flights_, {})) waiting_.returned(flight.history);
}

HistoryDelivery::Flight HistoryDelivery::ended(std::uint64_t id, SteadyTime now) {
  Flight flight = std::move(flights_.extract(id).mapped());
  const auto rest = std::min<SteadyTime::duration>((now - flight.since) / kRestShare, kLongestRest);
  rests_until_ = std::max(rests_until_, now + rest);
  return flight;
}

void HistoryDelivery::delivered(std::uint64_t id, SteadyTime now) {
  const Flight flight = ended(id, now);
  failpoint("history_acknowledged");
  waiting_.remove(flight.history, SampleEnd::acknowledged);
  refused_.accepted(flight.history.batch.stream.device, flight.since);
}

void HistoryDelivery::failed(const DeliveryFailed& event, SteadyTime now) {
  const auto [history, max_bytes, since] = ended(event.id, now);
  const HistoryBatch& batch = history.batch;
  payload_.history_undelivered(batch.stream.device);
  const bool can_be_cut = event.reason_code == kPacketTooLarge && batch.row_ids.size() > 1;
  if (is_final(event.reason_code) && !can_be_cut) {
    log::warn("history_refused", {{"device", batch.stream.device},
                                  {"rows", std::to_string(batch.row_ids.size())},
                                  {"code", hex_code(event.reason_code)},
                                  {"reason", event.text}});
    return waiting_.remove(history, SampleEnd::refused);
  }
  waiting_.returned(history);
  if (can_be_cut)
    max_bytes_ = std::min(max_bytes_, max_bytes / 2);  // once for messages of one size
  else
    refused_.refused(batch.stream.device, event, now);
}

SteadyTime HistoryDelivery::next_wake(SteadyTime now) const {
  const SteadyTime wake = refused_.next_end(
      now, [this](const std::string& device) { return waiting_.has_waiting(device); });
  return has_room() && rests_until_ > now ? std::min(wake, rests_until_) : wake;
}

}  // namespace fxagent
