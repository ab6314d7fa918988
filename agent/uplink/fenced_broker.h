// Broker of a gateway in a pair: connects and publishes only while this gateway is the holder, so
// that a gateway that was paused publishes no result that the other one has published. Uplink
// thread.
#pragma once

#include <memory>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "agent/handover/line_permit.h"
#include "agent/uplink/broker.h"

namespace fxagent {

class FencedBroker final : public Broker {
 public:
  /// `permit` outlives it.
  FencedBroker(std::unique_ptr<Broker> broker, const LinePermit& permit)
      : broker_(std::move(broker)), permit_(permit) {}

  void use(const MqttConfig& mqtt) override { broker_->use(mqtt); }
  void connect(std::size_t index, std::uint16_t receive_maximum) override {
    own_.clear();
    if (is_open() && permit_.was_confirmed_after(lost_at_))
      return broker_->connect(index, receive_maximum);
    own_.emplace_back(ConnectFailed{"the other gateway of the pair may be active"});
  }
  void disconnect(Will will) override { broker_->disconnect(will); }
  bool is_connected() const override { return own_.empty() && broker_->is_connected(); }
  void publish(Publication publication) override {
    if (!own_.empty()) return;
    if (is_open()) return broker_->publish(std::move(publication));
    broker_->disconnect(Will::published);
    own_.emplace_back(Lost{"this gateway of the pair is not confirmed as the active one", 0});
  }
  void subscribe(Subscription subscription) override {
    broker_->subscribe(std::move(subscription));
  }
  void unsubscribe(const std::string& filter) override { broker_->unsubscribe(filter); }
  void await_acknowledgements(bool awaited) override { broker_->await_acknowledgements(awaited); }
  void hold_messages(bool held, std::size_t let_in) override {
    broker_->hold_messages(held, let_in);
  }
  std::vector<BrokerEvent> take_events() override {
    std::vector<BrokerEvent> events = broker_->take_events();
    for (const BrokerEvent& event : events)
      if (std::holds_alternative<Lost>(event)) lost_at_ = boot_time_now();
    if (own_.empty()) return events;
    return std::exchange(own_, {});  // the connection is over for the caller
  }

 private:
  bool is_open() const { return permit_.holds(boot_time_now()); }

  const std::unique_ptr<Broker> broker_;
  const LinePermit& permit_;
  std::vector<BrokerEvent> own_;  ///< not taken yet
  /// A lost session may be one that the other gateway has ended: it is opened again only after a
  /// heartbeat that was sent later.
  BootTime lost_at_{};
};

/// Returns the broker with the fence of a pair, or as it is if `permit` is null.
inline std::unique_ptr<Broker> fenced(std::unique_ptr<Broker> broker, const LinePermit* permit) {
  if (permit == nullptr) return broker;
  return std::make_unique<FencedBroker>(std::move(broker), *permit);
}

}  // namespace fxagent
