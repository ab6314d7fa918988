// Publishes one profile of the config in an MQTT session of its own, with its own window and
// backlog, so that the loss of one broker does not touch the others. The profile determines topics
// and payloads; delivery works as for the agent's own samples. Uplink thread. Time is an argument.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <string>
#include <utility>

#include "agent/config/config_difference.h"
#include "agent/config/model.h"
#include "agent/handover/outbox.h"
#include "agent/handover/status.h"
#include "agent/steady_time.h"
#include "agent/store/guarded_store.h"
#include "agent/uplink/broker.h"
#include "agent/uplink/drop_warning.h"
#include "agent/uplink/jittered_backoff.h"
#include "agent/uplink/outgoing.h"
#include "agent/uplink/profile/profile.h"
#include "agent/uplink/samples/sample_delivery.h"
#include "agent/uplink/session/session.h"
#include "agent/uplink/session/shutdown.h"

namespace fxagent {

class Outlet final : private Outgoing::Sender {
 public:
  struct Settings {
    std::string name;  ///< of the profile, for the log and the status
    MqttConfig mqtt;   ///< with a client id of its own
    /// Returns `mqtt` of a changed config; empty: it stays.
    std::function<MqttConfig(const Config&)> mqtt_of;
    std::string boot;          ///< as in PublisherSettings
    std::string marker_topic;  ///< as in Outgoing; empty: none
    std::size_t backlog_bytes = std::size_t{64} << 20;
    std::uint32_t jitter_seed = 1;
  };

  /// All references outlive the outlet. `config` belongs to the uplink, which changes it before
  /// change(). `store` is null without a store. `utc_ms` returns the current calendar time.
  Outlet(const Config& config, Settings settings, Profile& profile, Broker& broker,
         std::function<std::int64_t()> utc_ms, GuardedStore* store);
  Outlet(const Outlet&) = delete;
  Outlet& operator=(const Outlet&) = delete;

  /// Lets a stop wait for the results of the profile's commands. `do_wait` returns true while some
  /// commands have no result yet.
  void answer_in_stop(std::function<bool()> do_wait) { commands_wait_ = std::move(do_wait); }

  /// Takes states and samples from the field. Call before the states of the batch are moved from.
  void take(const Outbox::Batch& batch, SteadyTime now);
  /// Adapts to a config change, which the config already contains. Connects anew if it changes the
  /// settings of the broker.
  void change(const ConfigChange& change, SteadyTime now);
  /// Does all that is due. Returns the time by which it must be called again.
  SteadyTime step(SteadyTime now);

  /// Begins the clean end: unsubscribes and sends what waits, for at most 1 s. The profile's last
  /// messages follow.
  void stop(SteadyTime now);
  bool finished() const { return shutdown_.finished(); }

  ProfileStatus status() const;

 private:
  /// The result of a command from the profile's broker.
  struct Result {
    Publication publication;
    SteadyTime since{};
    std::uint64_t flight = 0;  ///< id of the publication; 0: it waits
    SteadyTime not_before{};
    int failures = 0;
  };

  void take_broker_events(SteadyTime now);
  void send(SteadyTime now);
  SteadyTime next_wake(SteadyTime now) const;
  void subscribe(SteadyTime now);
  void subscribed(const Subscribed& event);
  void connection_began(const Connected& connected, SteadyTime now);
  void connection_ended();

  void take_results(SteadyTime now);
  void send_results(SteadyTime now);

  // Of what the profile itself publishes.
  void delivered(std::uint64_t id, SteadyTime now) override;
  void failed(const DeliveryFailed& event, SteadyTime now) override;

  const Config& config_;
  Settings settings_;
  Profile& profile_;
  Broker& broker_;
  const std::function<std::int64_t()> utc_ms_;
  GuardedStore* const store_;

  JitteredBackoff backoff_;
  Outgoing outgoing_;
  Session session_;
  SampleDelivery samples_;
  DropWarning drops_;
  Farewell farewell_;
  Shutdown shutdown_;

  std::function<bool()> commands_wait_ = [] { return false; };
  std::uint64_t collected_ = 0;
  std::deque<Result> results_;  ///< until the broker has them; oldest first
  std::uint64_t dropped_results_ = 0;
  // Subscriptions of this connection that the broker has not granted.
  std::map<std::string, std::string> ungranted_;  ///< logged reason by filter; empty: no answer yet
  SteadyTime subscribe_at_{};                     ///< time of the next SUBSCRIBE to these
  int subscribes_ = 0;                            ///< rounds so far; lengthen the pause
};

}  // namespace fxagent
