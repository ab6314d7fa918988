#include "tests/fleet/commander.h"

#include <algorithm>
#include <nlohmann/json.hpp>

namespace fxfleet {
namespace {

using std::chrono::seconds;

constexpr seconds kRetry{1};
constexpr seconds kRepeatAfter{5};
constexpr seconds kPingEvery{10};

}  // namespace

Commander::Commander(asio::io_context& io, const Plan& plan,
                     std::vector<std::unique_ptr<Player>>& players, double per_second)
    : plan_(plan),
      players_(players),
      per_second_(per_second),
      connection_(io, plan.version,
                  {[this] { opened(); }, [this](const Packet& packet) { received(packet); },
                   [this] { is_open_ = is_subscribed_ = false; }}) {}

void Commander::step(Time now) {
  if (per_second_ <= 0) return;
  if (!is_open_) {
    if (now < retry_at_) return;
    retry_at_ = now + kRetry;
    is_open_ = true;
    return connection_.open(plan_.servers.back(), asio::ip::address_v4::loopback());
  }
  if (!is_subscribed_) return;
  for (auto& [id, pending] : pending_) {
    if (now - pending.last < kRepeatAfter || !pending.player->is_connected()) continue;
    pending.repeated = true;
    ++repeated_;
    send(id, pending, now);
  }
  if (now - heard_at_ > kPingEvery) {
    heard_at_ = now;
    put_pingreq(connection_.out());
  }
  if (!sends_) return;
  next_at_ = std::max(next_at_, now - seconds(1));
  for (; next_at_ <= now;
       next_at_ += std::chrono::microseconds(static_cast<long>(1'000'000 / per_second_))) {
    std::uniform_int_distribution<std::size_t> any(0, players_.size() - 1);
    Player& player = *players_[any(random_)];
    if (!player.is_connected()) continue;
    const std::string id = "command-" + std::to_string(++number_);
    send(id, pending_.emplace(id, Pending{&player, now, now}).first->second, now);
  }
}

void Commander::leave() {
  if (is_subscribed_) put_disconnect(connection_.out());
  is_subscribed_ = false;
}

void Commander::opened() {
  put_connect(connection_.out(), plan_.version, {"fxfleet-commander", 30, true, {}, {}});
}

void Commander::received(const Packet& packet) {
  switch (packet.type) {
    case PacketType::connack:
      put_subscribe(connection_.out(), plan_.version, 1, plan_.root + "/+/+/result", false);
      break;
    case PacketType::suback:
      is_subscribed_ = true;
      break;
    case PacketType::publish:
      if (packet.id != 0) put_puback(connection_.out(), packet.id);
      result(packet.payload);
      break;
    default:
      break;
  }
}

void Commander::result(std::string_view payload) {
  const auto json = nlohmann::json::parse(payload, nullptr, /*allow_exceptions=*/false);
  if (!json.is_object()) return;
  const auto found = pending_.find(json.value("id", ""));
  if (found == pending_.end()) {
    if (json.value("status", "") != "DUPLICATE") ++second_results_;
    return;
  }
  if (!found->second.repeated) times_.add(std::chrono::steady_clock::now() - found->second.first);
  pending_.erase(found);
}

void Commander::send(const std::string& id, Pending& pending, Time now) {
  pending.last = now;
  const auto next = static_cast<std::uint16_t>(last_id_ % 60000 + 1);
  last_id_ = next;
  put_publish(connection_.out(), plan_.version, last_id_,
              {pending.player->command_topic(),
               R"({"op": "write", "address": "D300", "value": 3, "id": ")" + id + "\"}", 1, false});
}

}  // namespace fxfleet
