// The profile `plain`: a retained topic for each tag, with its bare value as JSON; null while the
// tag is bad. A value is published when it changes, and once in each connection. Samples that wait
// for 1 s follow on {topic}/history as [[time, value], …], not retained; the newest value is then
// published without its sample. A message on {topic}/set writes a tag, if it may be written; the
// result follows on {topic}/result.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "agent/config/plain_topic.h"
#include "agent/uplink/outgoing.h"
#include "agent/uplink/profile/profile.h"

namespace fxagent {

class PlainProfile final : public Profile, private Outgoing::Sender {
 public:
  /// `config` outlives it. `new_id` returns an id for a command, each time another one.
  PlainProfile(const Config& config, const ProfileConfig& profile, RelayCommand relay,
               std::function<std::string()> new_id);

  void begin(Outgoing& outgoing, JitteredBackoff& backoff) override {
    outgoing_ = &outgoing;
    backoff_ = &backoff;
  }
  Publication last_will() override { return retained(state_topic_, R"("offline")"); }
  std::vector<Subscription> subscriptions() const override;
  void connection_began(const Connected& connected) override;
  void connection_ended() override {
    due_.clear();
    flights_.clear();
  }
  SteadyTime next_wake() const override { return wake_; }
  void saw(const Telemetry& sample, SteadyTime now) override;
  void hear(const Message& message) override;
  void change(const ConfigChange& change) override;
  std::vector<Publication> due(SteadyTime now, std::int64_t utc_ms) override;
  std::vector<Publication> take_results() override { return std::exchange(results_, {}); }
  std::vector<Publication> farewell(std::int64_t) override { return {last_will()}; }

  std::vector<Publication> sample(const StreamKey& stream, const SampleRecord& sample) override;
  void undelivered(const std::string& device) override;
  void history_undelivered(const std::string&) override {}
  std::shared_ptr<SampleHistory> begin_history(std::size_t max_bytes) override;

 private:
  class History;
  /// The text of a retained topic.
  struct Shown {
    std::string newest{};                    ///< empty: no tag has the topic any more
    std::optional<std::size_t> published{};  ///< hash of the last text in this connection
  };

  struct Due {
    SteadyTime not_before{};
    int failures = 0;
  };
  struct Flight {
    std::string topic;
    int failures = 0;
    bool clears = false;
  };

  void find_writable();
  Publication value(const std::string& topic, std::string text) const;
  void publish(const std::string& topic, int failures);
  void delivered(std::uint64_t id, SteadyTime now) override;
  void failed(const DeliveryFailed& event, SteadyTime now) override;

  const Config& config_;
  const std::string name_;
  const std::string broker_;
  const PlainTopic topics_;
  const std::string state_topic_;
  const RelayCommand relay_;
  const std::function<std::string()> new_id_;
  Outgoing* outgoing_ = nullptr;        ///< from begin() on
  JitteredBackoff* backoff_ = nullptr;  ///< from begin() on
  /// Device and tag by topic, of the tags that may be written.
  std::unordered_map<std::string, std::pair<std::string, std::string>> writable_;
  std::unordered_map<std::string, Shown> shown_;  ///< by topic
  std::map<std::string, Due> due_;                ///< by topic; its newest text is published
  std::string last_due_;                          ///< topic that was published last of due_
  std::map<std::uint64_t, Flight> flights_;       ///< by publication id, without those of samples
  SteadyTime wake_ = SteadyTime::max();           ///< after due()
  std::vector<Publication> results_;
};

}  // namespace fxagent
