#include "agent/uplink/sparkplug/birth_schedule.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

#include "agent/log/log.h"
#include "agent/text/json.h"

namespace fxagent::sparkplug {
namespace {

// Bytes of a PUBLISH besides its payload: the topic and the headers.
constexpr std::size_t kRoomForTopic = 512;

}  // namespace

// ---- the primary host ---------------------------------------------------------------------------

PrimaryHost::PrimaryHost(std::string topic, bool old_state)
    : topic_(std::move(topic)), old_state_(old_state) {}

void PrimaryHost::hear(std::string_view payload) {
  if (old_state_) {
    if (payload == "ONLINE" || payload == "OFFLINE")
      return set(payload == "ONLINE" ? State::online : State::offline, 0);
  } else {
    const auto state = parsed_json(payload);
    const auto& online = member(state, "online");
    const auto& timestamp = member(state, "timestamp");
    if (online.is_boolean() && timestamp.is_number_integer())
      return set(online.get<bool>() ? State::online : State::offline,
                 timestamp.get<std::int64_t>());
  }
  log::warn("host_state_ignored", {{"topic", topic_},
                                   {"text", log::excerpt(payload)},
                                   {"note", old_state_ ? "expected ONLINE or OFFLINE"
                                                       : "expected {\"online\": true or false, "
                                                         "\"timestamp\": number}"}});
}

/// A state that is older than the last online state is a leftover.
void PrimaryHost::set(State state, std::int64_t timestamp) {
  const bool is_online = state == State::online;
  if (timestamp < (is_online ? last_ : last_online_))
    return log::warn("host_state_ignored",
                     {{"topic", topic_},
                      {"timestamp", std::to_string(timestamp)},
                      {"note", "its timestamp is older than that of the state before"}});
  last_ = timestamp;
  if (is_online) last_online_ = timestamp;
  if (state != state_)
    log::info("primary_host", {{"topic", topic_}, {"state", is_online ? "online" : "offline"}});
  state_ = state;
}

// ---- the schedule -------------------------------------------------------------------------------

BirthSchedule::BirthSchedule(const Config& config, std::string broker, PrimaryHost host)
    : config_(config),
      broker_(std::move(broker)),
      host_(std::move(host)),
      devices_(config.devices.size()) {
  for (std::uint32_t i = 0; i < devices_.size(); ++i) prepare(i);
}

void BirthSchedule::prepare(std::uint32_t index) {
  const DeviceConfig& device = config_.devices.at(index);
  if (!device.is_vacant()) index_[device.name] = index;
}

std::optional<std::uint32_t> BirthSchedule::index_of(std::string_view device) const {
  const auto found = index_.find(device);
  return found == index_.end() ? std::nullopt : std::optional(found->second);
}

// ---- session ------------------------------------------------------------------------------------

void BirthSchedule::begin_session() {
  if (std::exchange(has_connected_, false)) ++session_;
}

void BirthSchedule::connection_began(const Connected& connected) {
  has_connected_ = true;
  host_.connection_began();
  max_packet_ = connected.maximum_packet;
  rebirth_ = true;
  born_at_ = {};
  leaves_ = false;
  for (Device& device : devices_) device.is_too_large = false;
  if (!host_.is_online())
    log::info("primary_host", {{"topic", host_.topic()}, {"state", "awaited"}});
}

void BirthSchedule::connection_ended() {
  is_born_ = false;
  rebirth_ = false;
  dead_.clear();
  for (Device& device : devices_) device.is_born = false;
}

bool BirthSchedule::hear(const Message& message) {
  if (host_.topic().empty() || message.topic != host_.topic()) return false;
  host_.hear(message.payload);
  // With one server there is nowhere to go: the session waits there for the host.
  leaves_ = host_.is_offline() && (is_born_ || broker_of(config_, broker_).servers.size() > 1);
  return true;
}

bool BirthSchedule::take_leave() { return std::exchange(leaves_, false); }

// ---- births and deaths --------------------------------------------------------------------------

void BirthSchedule::device_state(const DeviceStatus& status) {
  devices_.at(status.device).is_alive = status.is_alive();
  due_.insert(status.device);
}

void BirthSchedule::change(const ConfigChange& change) {
  for (const std::uint32_t i : change.devices_end) {
    const auto found =
        std::ranges::find(index_, i, &std::pair<const std::string, std::uint32_t>::second);
    if (found == index_.end()) continue;
    if (devices_.at(i).is_born) dead_.push_back(found->first);
    index_.erase(found);
    devices_[i] = Device{};
  }
  devices_.resize(config_.devices.size());
  for (const std::uint32_t i : change.devices_begin) prepare(i);
}

std::vector<BirthSchedule::Step> BirthSchedule::due(SteadyTime now) {
  using Kind = Step::Kind;
  std::vector<Step> steps;
  if (!host_.is_online() || (!rebirth_ && !is_born_)) return steps;
  if (rebirth_) {
    if (is_born_ && now < born_at_ + kRebirthEvery) return steps;
    rebirth_ = false;
    is_born_ = true;
    born_at_ = now;
    dead_.clear();
    steps.push_back({.kind = Kind::node_birth});
    for (std::uint32_t i = 0; i < devices_.size(); ++i) {
      devices_[i].is_born = false;
      due_.insert(i);
    }
  }
  for (std::string& name : std::exchange(dead_, {}))
    steps.push_back({.kind = Kind::device_death, .device = std::move(name)});
  for (const std::uint32_t i : std::exchange(due_, {})) {
    Device& device = devices_[i];
    if (device.is_alive == device.is_born) continue;
    device.is_born = device.is_alive;
    steps.push_back({.kind = device.is_alive ? Kind::device_birth : Kind::device_death,
                     .index = i,
                     .device = config_.devices[i].name});
  }
  return steps;
}

std::vector<std::uint32_t> BirthSchedule::born() const {
  std::vector<std::uint32_t> found;
  for (std::uint32_t i = 0; i < devices_.size(); ++i)
    if (devices_[i].is_born) found.push_back(i);
  return found;
}

SteadyTime BirthSchedule::next_wake() const {
  return rebirth_ && host_.is_online() ? born_at_ + kRebirthEvery : SteadyTime::max();
}

bool BirthSchedule::may_send(std::uint32_t device) const {
  return devices_[device].is_alive && !devices_[device].is_too_large;
}

std::size_t BirthSchedule::most_bytes() const {
  return max_packet_ - std::min(max_packet_, kRoomForTopic);
}

bool BirthSchedule::accepts_birth(std::uint32_t device, std::size_t bytes) {
  if (bytes <= most_bytes()) return true;
  devices_[device].is_born = false;
  if (std::exchange(devices_[device].is_too_large, true)) return false;
  log::error("birth_too_large",
             {{"device", config_.devices[device].name},
              {"bytes", std::to_string(bytes)},
              {"note", "the broker accepts " + std::to_string(max_packet_) +
                           " bytes: raise its limit, or divide the device's tags among several "
                           "devices of the config"}});
  return false;
}

}  // namespace fxagent::sparkplug
