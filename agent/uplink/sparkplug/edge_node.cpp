#include "agent/uplink/sparkplug/edge_node.h"

#include <algorithm>
#include <utility>

#include "agent/log/log.h"
#include "agent/text/json.h"

namespace fxagent::sparkplug {
namespace {

// Bytes of a PUBLISH besides its payload: the topic and the headers.
constexpr std::size_t kRoomForTopic = 512;

}  // namespace

std::optional<std::size_t> place_of(const SharedVector<TagConfig>& tags, std::string_view name,
                                    std::size_t from) {
  for (std::size_t i = 0; i < tags.size(); ++i) {
    const std::size_t place = (from + i) % tags.size();
    if (std::string_view(tags[place].name) == name) return place;
  }
  return std::nullopt;
}

// ---- the primary host ---------------------------------------------------------------------------

PrimaryHost::PrimaryHost(std::string topic, bool old_state)
    : topic_(std::move(topic)), old_state_(old_state) {}

void PrimaryHost::hear(std::string_view payload) {
  if (old_state_) {
    if (payload == "ONLINE" || payload == "OFFLINE") return set(payload == "ONLINE", 0);
  } else {
    const auto state = parsed_json(payload);
    const auto& online = member(state, "online");
    const auto& timestamp = member(state, "timestamp");
    if (online.is_boolean() && timestamp.is_number_integer())
      return set(online.get<bool>(), timestamp.get<std::int64_t>());
  }
  log::warn("host_state_ignored", {{"topic", topic_},
                                   {"text", log::excerpt(payload)},
                                   {"note", old_state_ ? "expected ONLINE or OFFLINE"
                                                       : "expected {\"online\": true or false, "
                                                         "\"timestamp\": number}"}});
}

/// A state that is older than the last online state is a leftover.
void PrimaryHost::set(bool online, std::int64_t timestamp) {
  if (timestamp < (online ? last_ : last_online_))
    return log::warn("host_state_ignored",
                     {{"topic", topic_},
                      {"timestamp", std::to_string(timestamp)},
                      {"note", "its timestamp is older than that of the state before"}});
  last_ = timestamp;
  if (online) last_online_ = timestamp;
  if (online_ != online)
    log::info("primary_host", {{"topic", topic_}, {"state", online ? "online" : "offline"}});
  online_ = online;
}

// ---- session ------------------------------------------------------------------------------------

EdgeNode::EdgeNode(const Config& config, const ProfileConfig& profile, const std::string& version,
                   PrimaryHost host, RelayCommand relay, std::function<std::int64_t()> utc_ms)
    : config_(config),
      name_(name_of(profile)),
      prefix_(version + "/" + profile.group + "/"),
      node_(profile.node),
      relay_(std::move(relay)),
      utc_ms_(std::move(utc_ms)),
      broker_(profile.broker),
      host_(std::move(host)),
      lives_(config.devices.size()) {
  for (std::uint32_t i = 0; i < lives_.size(); ++i)
    if (!config.devices[i].is_vacant()) index_[config.devices[i].name] = i;
}

std::optional<std::uint32_t> EdgeNode::index_of(std::string_view device) const {
  const auto found = index_.find(device);
  return found == index_.end() ? std::nullopt : std::optional(found->second);
}

Publication EdgeNode::message(std::string_view type, const std::string& device,
                              std::string payload) const {
  return {.topic = prefix_ + std::string(type) + "/" + node_ + (device.empty() ? "" : "/" + device),
          .payload = std::move(payload),
          .qos = 0};
}

Publication EdgeNode::last_will() {
  if (std::exchange(has_connected_, false)) ++session_;
  return node_death(utc_ms_());
}

std::vector<Publication> EdgeNode::farewell(std::int64_t utc_ms) {
  if (!is_born_) return {};
  return {node_death(utc_ms)};
}

void EdgeNode::connection_began(const Connected& connected) {
  has_connected_ = true;
  host_.connection_began();
  max_packet_ = connected.maximum_packet;
  rebirth_ = true;
  leaves_ = false;
  for (Life& life : lives_) life.is_too_large = false;
  if (!host_.is_online())
    log::info("primary_host", {{"topic", host_.topic()}, {"state", "awaited"}});
}

bool EdgeNode::hear_host(const Message& message) {
  if (host_.topic().empty() || message.topic != host_.topic()) return false;
  host_.hear(message.payload);
  // With one server there is nowhere to go: the session waits there for the host.
  leaves_ = host_.is_offline() && (is_born_ || broker_of(config_, broker_).servers.size() > 1);
  return true;
}

bool EdgeNode::take_server_change() { return std::exchange(leaves_, false); }

// ---- births and deaths --------------------------------------------------------------------------

void EdgeNode::device_state(const DeviceStatus& status) {
  lives_.at(status.device).is_alive = status.is_alive();
  due_.insert(status.device);
}

void EdgeNode::change(const ConfigChange& change) {
  for (const std::uint32_t i : change.devices_end) {
    const auto found =
        std::ranges::find(index_, i, &std::pair<const std::string, std::uint32_t>::second);
    if (found == index_.end()) continue;
    if (lives_.at(i).is_born) dead_.push_back(found->first);
    index_.erase(found);
    lives_[i] = Life{};
  }
  lives_.resize(config_.devices.size());
  for (const std::uint32_t i : change.devices_begin) index_[config_.devices[i].name] = i;
}

std::vector<Publication> EdgeNode::due(SteadyTime now, std::int64_t utc_ms) {
  std::vector<Publication> messages;
  if (!host_.is_online() || (!rebirth_ && !is_born_)) return messages;
  if (rebirth_) {
    if (is_born_ && now < born_at_ + kRebirthEvery) return messages;
    rebirth_ = false;
    is_born_ = true;
    born_at_ = now;
    dead_.clear();
    messages.push_back(node_birth(now, utc_ms));
    for (std::uint32_t i = 0; i < lives_.size(); ++i) {
      lives_[i].is_born = false;
      due_.insert(i);
    }
  }
  for (const std::string& name : std::exchange(dead_, {}))
    messages.push_back(device_death(name, utc_ms));
  for (const std::uint32_t i : std::exchange(due_, {})) {
    Life& life = lives_[i];
    if (life.is_alive == life.is_born) continue;
    life.is_born = life.is_alive;
    if (!life.is_alive)
      messages.push_back(device_death(config_.devices[i].name, utc_ms));
    else if (auto birth = device_birth(i, utc_ms))
      messages.push_back(std::move(*birth));
  }
  return messages;
}

std::vector<std::uint32_t> EdgeNode::born() const {
  std::vector<std::uint32_t> found;
  for (std::uint32_t i = 0; i < lives_.size(); ++i)
    if (lives_[i].is_born) found.push_back(i);
  return found;
}

SteadyTime EdgeNode::next_wake() const {
  return rebirth_ && host_.is_online() ? born_at_ + kRebirthEvery : SteadyTime::max();
}

bool EdgeNode::may_send(const std::string& device) const {
  const auto index = index_of(device);
  return !index || (lives_[*index].is_alive && !lives_[*index].is_too_large);
}

std::size_t EdgeNode::most_bytes() const {
  return max_packet_ - std::min(max_packet_, kRoomForTopic);
}

bool EdgeNode::accepts_birth(std::uint32_t device, std::size_t bytes) {
  if (bytes <= most_bytes()) return true;
  Life& life = lives_[device];
  life.is_born = false;
  if (std::exchange(life.is_too_large, true)) return false;
  log::error("birth_too_large",
             {{"device", config_.devices[device].name},
              {"bytes", std::to_string(bytes)},
              {"note", "the broker accepts " + std::to_string(max_packet_) +
                           " bytes: raise its limit, or divide the device's tags among several "
                           "devices of the config"}});
  return false;
}

}  // namespace fxagent::sparkplug
