// The MQTT session in which a gateway of a pair hears the other one. It has the client id of this
// gateway, and the broker keeps it for an hour. Connects again after a growing pause, and asks
// again for subscriptions that the broker has refused or not answered. Lives on the pair's thread;
// its faults are logged.
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "agent/handover/line_permit.h"
#include "agent/pair/pair_state.h"
#include "agent/uplink/broker.h"

namespace fxagent {

class MemberSession final {
 public:
  /// `peers` learns from when to when the session hears them; it must outlive this object.
  /// `servers`: of the broker, at least 1; `base`: of all topics of the pair.
  MemberSession(std::unique_ptr<Broker> broker, std::size_t servers, const std::string& base,
                PairPeers& peers);

  /// Connects or subscribes if it is time to. The first call connects.
  void keep(BootTime now);
  /// Takes the events of the broker, and passes each of them on to `rest`.
  void take_events(BootTime now, const std::function<void(const BrokerEvent&)>& rest);

  bool is_up() const { return up_; }
  /// True if the broker has kept the session since the last process of this gateway and refused no
  /// subscription, so that no announcement or result is missing.
  bool heard_all() const { return heard_all_; }
  /// Index of the server that it is connected to, or connects to.
  std::size_t server() const { return server_; }
  /// For publications and the end of the session.
  Broker& broker() { return *broker_; }

 private:
  void connected(const Connected& event, BootTime now);
  void subscribed(const Subscribed& event, BootTime now);
  void lost(const Lost& event, BootTime now);
  void log_once(const std::string& failure);
  void connect_after(BootTime pause, BootTime now);
  void subscribe(BootTime now);

  const std::unique_ptr<Broker> broker_;
  std::vector<std::string> failures_;  ///< of each server, the last since the session was up
  std::vector<std::string> filters_;
  PairPeers& peers_;
  std::size_t server_ = 0;
  bool up_ = false;
  BootTime up_since_{};
  std::optional<BootTime> connect_at_ = BootTime{};  ///< nullopt: it is connected, or connects
  int thrown_ = 0;  ///< times in a row that the session was taken over or was short
  bool heard_all_ = true;
  bool missed_ = false;            ///< it may lack announcements, which is not logged yet
  std::set<std::string> unheard_;  ///< filters that the broker has not granted in this session
  std::set<std::string> refused_;  ///< those of them that it has refused; logged once
  BootTime subscribe_at_{};        ///< time of the next SUBSCRIBE to unheard_
  int repeats_ = 0;                ///< of SUBSCRIBE in this session; lengthen the pause
};

}  // namespace fxagent
