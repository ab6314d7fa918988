#include "agent/uplink/profile/plain_profile.h"

#include <algorithm>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <string_view>
#include <unordered_set>

#include "agent/text/json_writer.h"
#include "agent/uplink/jittered_backoff.h"
#include "agent/uplink/payload/json_payload.h"
#include "agent/uplink/samples/sample_spool.h"

namespace fxagent {
namespace {

constexpr std::string_view kSet = "/set";
constexpr const char* kOnline = "\"online\"";

}  // namespace

/// Gathers `[time, value]` of each tag.
class PlainProfile::History final : public SampleHistory {
 public:
  History(const PlainProfile& profile, std::size_t max_bytes)
      : profile_(profile), max_bytes_(max_bytes) {}

  bool add(const SampleRecord& sample) override {
    std::vector<std::string> values;
    std::size_t more = 0;
    for (const RecordedReading& reading : sample.readings) {
      json::Writer out;
      out.begin_array().integer(sample.ts_ms).raw(json::bare_value(reading)).end_array();
      values.push_back(out.take());
      more += values.back().size() + 1;
    }
    if (bytes_ != 0 && bytes_ + more > max_bytes_) return false;
    bytes_ += more;
    for (std::size_t i = 0; i < values.size(); ++i) {
      std::string& list = lists_[std::string(sample.readings[i].name)];
      list += (list.empty() ? "[" : ",") + values[i];
    }
    return true;
  }
  std::vector<Publication> take(const StreamKey& stream) override {
    std::vector<Publication> messages;
    for (auto& [tag, list] : lists_)
      messages.push_back(
          {.topic = profile_.topics_.of(stream.device, stream.group, tag) + "/history",
           .payload = std::move(list) + "]",
           .qos = broker_of(profile_.config_, profile_.broker_).qos});
    return messages;
  }

 private:
  const PlainProfile& profile_;
  const std::size_t max_bytes_;
  std::size_t bytes_ = 0;
  std::map<std::string, std::string> lists_;  ///< by tag
};

PlainProfile::PlainProfile(const Config& config, const ProfileConfig& profile, RelayCommand relay,
                           std::function<std::string()> new_id)
    : config_(config),
      name_(name_of(profile)),
      broker_(profile.broker),
      topics_(PlainTopic::parse(profile.topic, config.root, config.id).value()),
      state_topic_(config.base_topic() + "/plain"),
      relay_(std::move(relay)),
      new_id_(std::move(new_id)) {
  find_writable();
}

void PlainProfile::find_writable() {
  writable_.clear();
  if (!relay_) return;
  for (const DeviceConfig& device : config_.devices)
    for (const TagConfig& tag : device.tags) {
      if (!tag.writable) continue;
      const std::string name(tag.name);
      writable_.emplace(topics_.of(device.name, device.groups.at(tag.group).name, name),
                        std::pair(device.name, name));
    }
}

std::vector<Subscription> PlainProfile::subscriptions() const {
  if (!relay_) return {};
  return {{topics_.filter() + std::string(kSet), /*no_local=*/true}};
}

void PlainProfile::connection_began(const Connected&) {
  shown_[state_topic_].newest = kOnline;
  for (auto& [topic, shown] : shown_) {
    shown.published.reset();
    due_.try_emplace(topic);  // after samples that were read just now
  }
  due_.erase(state_topic_);
  publish(state_topic_, 0);
}

/// Keeps the newest values: samples that find no room for 1 s become history, which is not
/// retained. A group that is published on change may not be read as changed for hours.
void PlainProfile::saw(const Telemetry& sample, SteadyTime now) {
  const DeviceConfig& device = config_.devices.at(sample.device);
  const std::string& group = device.groups.at(sample.group).name;
  for (const TagReading& reading : sample.readings) {
    const TagConfig& tag = device.tags.at(reading.tag);
    RecordedReading recorded;
    recorded.type = tag.point.type;
    recorded.scaled = tag.point.scaled();
    recorded.bad = reading.bad;
    recorded.value = reading.value;
    const std::string topic = topics_.of(device.name, group, tag.name);
    Shown& shown = shown_[topic];
    shown.newest = json::bare_value(recorded);
    if (shown.published == std::hash<std::string>{}(shown.newest)) continue;
    due_.try_emplace(topic, Due{now + SampleSpool::kLiveFor, 0});
  }
}

void PlainProfile::hear(const Message& message) {
  std::string topic = message.topic;
  if (!topic.ends_with(kSet) || only_clears(message, broker_of(config_, broker_))) return;
  topic.resize(topic.size() - kSet.size());
  const auto found = writable_.find(topic);
  if (found == writable_.end())
    return ignore_command(message, "no tag with access: read_write has this topic");
  const auto& [device, tag] = found->second;
  RelayedCommand command = relayed_command(message, device, name_);
  command.reply = [this, topic](const std::string& result) {
    results_.push_back({.topic = topic + "/result", .payload = result});
  };
  // Text that is not JSON becomes a string, which a number's tag refuses with a reason. The library
  // would read a NUL as the end of the text.
  const bool is_json =
      message.payload.find('\0') == std::string::npos && nlohmann::json::accept(message.payload);
  // Admission refuses an empty message: it is neither JSON nor a text for a tag.
  if (!message.payload.empty())
    command.payload = write_command(
        new_id_(), tag, is_json ? message.payload : json::Writer().string(message.payload).take());
  relay_(std::move(command));
}

void PlainProfile::change(const ConfigChange&) {
  find_writable();
  // Topics that no tag has any more.
  std::unordered_set<std::string> topics{state_topic_};
  for (const DeviceConfig& device : config_.devices)
    for (const TagConfig& tag : device.tags)
      topics.insert(topics_.of(device.name, device.groups.at(tag.group).name, tag.name));
  for (auto& [topic, shown] : shown_) {
    if (topics.contains(topic) || shown.newest.empty()) continue;
    shown.newest.clear();
    due_[topic] = {};
  }
}

/// Sends the texts itself, each topic in its turn. They leave room for samples and results.
std::vector<Publication> PlainProfile::due(SteadyTime now, std::int64_t) {
  wake_ = SteadyTime::max();
  auto next = due_.upper_bound(last_due_);
  for (std::size_t left = due_.size(); left > 0; --left) {
    if (next == due_.end()) next = due_.begin();
    if (2 * flights_.size() >= outgoing_->window() || !outgoing_->has_room_for_samples()) break;
    const auto current = next++;
    if (current->second.not_before > now) {
      wake_ = std::min(wake_, current->second.not_before);
      continue;
    }
    const auto taken = due_.extract(current);
    publish(taken.key(), taken.mapped().failures);
    last_due_ = taken.key();
  }
  return {};
}

void PlainProfile::publish(const std::string& topic, int failures) {
  const auto found = shown_.find(topic);
  if (found == shown_.end()) return;  // cleared meanwhile
  auto& [newest, published] = found->second;
  const std::size_t hash = std::hash<std::string>{}(newest);
  if (std::exchange(published, hash) == hash) return;
  const std::uint64_t id = outgoing_->send(*this, value(topic, newest));
  flights_.emplace(id, Flight{topic, failures, newest.empty()});
}

void PlainProfile::delivered(std::uint64_t id, SteadyTime) {
  const Flight flight = std::move(flights_.extract(id).mapped());
  const auto shown = shown_.find(flight.topic);
  if (flight.clears && shown != shown_.end() && shown->second.newest.empty()) shown_.erase(shown);
}

void PlainProfile::failed(const DeliveryFailed& event, SteadyTime now) {
  const auto& [topic, failures, clears] = flights_.at(event.id);
  if (failures == 0) log_failed(name_, event);
  if (is_final(event.reason_code)) return delivered(event.id, now);
  const auto shown = shown_.find(topic);
  if (shown != shown_.end()) shown->second.published.reset();
  due_[topic] = {now + backoff_->after(failures), failures + 1};
  flights_.erase(event.id);
}

Publication PlainProfile::value(const std::string& topic, std::string text) const {
  Publication publication = retained(topic, std::move(text));
  // A topic counts as cleared only when the broker has acknowledged it.
  if (topic != state_topic_ && !publication.payload.empty())
    publication.qos = broker_of(config_, broker_).qos;
  return publication;
}

std::vector<Publication> PlainProfile::sample(const StreamKey& stream, const SampleRecord& sample) {
  std::vector<Publication> changed;
  for (const RecordedReading& reading : sample.readings) {
    const std::string topic = topics_.of(stream.device, stream.group, reading.name);
    std::string text = json::bare_value(reading);
    const std::size_t hash = std::hash<std::string>{}(text);
    const auto shown = shown_.find(topic);
    if (shown == shown_.end() || shown->second.newest.empty()) continue;  // no tag has it any more
    if (std::exchange(shown->second.published, hash) == hash) continue;
    if (text == shown->second.newest)
      due_.erase(topic);
    else
      due_.try_emplace(topic);  // of a sample that waited
    changed.push_back(value(topic, std::move(text)));
  }
  return changed;
}

void PlainProfile::undelivered(const std::string& device) {
  for (const DeviceConfig& each : config_.devices) {
    if (each.name != device) continue;
    for (const TagConfig& tag : each.tags) {
      const auto shown = shown_.find(topics_.of(device, each.groups.at(tag.group).name, tag.name));
      if (shown == shown_.end()) continue;
      shown->second.published.reset();
      due_.try_emplace(shown->first, Due{{}, 1});  // the refusal is logged
    }
  }
}

std::shared_ptr<SampleHistory> PlainProfile::begin_history(std::size_t max_bytes) {
  return std::make_shared<History>(*this, max_bytes);
}

}  // namespace fxagent
