// The profile `plain`: a retained topic for each tag, with its bare value as JSON; null while the
// tag is bad. A value is published when it changes, and once in each connection. After an outage
// the values that were missed follow on {topic}/history as [[time, value], …], not retained. A
// message on {topic}/set writes a tag, if it may be written; the result follows on {topic}/result.
#pragma once

#include <cstddef>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "agent/config/plain_topic.h"
#include "agent/uplink/profile/profile.h"

namespace fxagent {

class PlainProfile final : public Profile {
 public:
  /// `config` outlives it. `relay` is empty if the broker may not send commands. `new_id`
  /// returns an id for a command, each time another one.
  PlainProfile(const Config& config, const ProfileConfig& profile, RelayCommand relay,
               std::function<std::string()> new_id);

  Publication last_will() override { return retained(state_topic_, R"("offline")"); }
  std::vector<Subscription> subscriptions() const override;
  void connection_began(const Connected& connected) override;
  void connection_ended() override;
  void saw(const Telemetry& sample) override;
  void hear(const Message& message) override;
  void change(const ConfigChange& change) override;
  std::vector<Publication> due(SteadyTime now, std::int64_t utc_ms) override;
  std::vector<Publication> take_results() override { return std::exchange(results_, {}); }
  std::vector<Publication> farewell(std::int64_t) override { return {last_will()}; }

  std::vector<Publication> sample(const StreamKey& stream, const SampleRecord& sample) override;
  void undelivered(const std::string& device) override;
  std::shared_ptr<SampleHistory> begin_history(std::size_t max_bytes) override;

 private:
  class History;
  /// The value of a tag.
  struct Shown {
    std::string newest{};                    ///< text of the last reading; empty: none
    std::optional<std::size_t> published{};  ///< hash of the last text in this connection
  };

  void find_writable();
  Publication value(const std::string& topic, std::string text) const;

  const Config& config_;
  const std::string name_;
  const std::string broker_;
  const PlainTopic topics_;
  const std::string state_topic_;
  const RelayCommand relay_;
  const std::function<std::string()> new_id_;
  /// Device and tag by topic, of the tags that may be written.
  std::unordered_map<std::string, std::pair<std::string, std::string>> writable_;
  std::unordered_map<std::string, Shown> shown_;  ///< by topic
  std::deque<Publication> due_;
  std::vector<Publication> results_;
};

}  // namespace fxagent
