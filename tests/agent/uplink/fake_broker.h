// A broker in memory that behaves like a real one: it answers later, acknowledges when the test
// says so, refuses, breaks the connection, and keeps retained messages. The caller takes its
// events; there are no callbacks.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <deque>

#include "agent/uplink/broker.h"

namespace fxagent::test {

class FakeBroker final : public Broker {
 public:
  // ---- the Broker interface --------------------------------------------------------------------
  void use(const MqttConfig& mqtt) override { used.push_back(mqtt); }
  void connect(std::size_t index, std::uint16_t may_send_ahead) override {
    connects.push_back(index);
    sends_ahead = may_send_ahead;
    events_.clear();
    open_.clear();
    filters.clear();
    up_ = reachable;
    if (up_)
      events_.push_back(Connected{session_present, receive_maximum, maximum_packet});
    else if (answers)
      events_.push_back(ConnectFailed{"connection refused"});
  }
  void disconnect(Will will = Will::discarded) override {
    ++disconnects;
    left_with_will = will == Will::published;
    up_ = false;
    events_.push_back(Disconnected{});
  }
  void publish(Publication publication) override {
    if (!up_) {
      if (finds_out) events_.push_back(Lost{"disconnected"});
      return;
    }
    log.push_back(publication);
    if (fails) {
      events_.push_back(DeliveryFailed{publication.id, 0, "no more room"});
      return;
    }
    if (!refuses_topic.empty() && publication.topic.find(refuses_topic) != std::string::npos) {
      events_.push_back(DeliveryFailed{publication.id, 0x97, "quota exceeded"});
      return;
    }
    most_open = std::max(most_open, open_.size() + 1);
    if (acknowledges || (acknowledges_qos0 && publication.qos == 0))
      take(publication);
    else
      open_.push_back(std::move(publication));
  }
  void subscribe(Subscription subscription) override {
    filters.insert(subscription.filter);
    order.push_back("subscribe " + subscription.filter);
    const bool of_states = !subscription.filter.ends_with("/command");
    const std::string why = refuses_states && of_states ? "Not authorized" : refusal;
    if (confirms) events_.push_back(Subscribed{subscription.filter, why.empty(), why});
  }
  bool is_connected() const override {
    ++checks;
    return up_ || believes;
  }
  void unsubscribe(const std::string& filter) override { filters.erase(filter); }
  void await_acknowledgements(bool awaited) override { acknowledgements_awaited = awaited; }
  void hold_messages(bool now_held, std::size_t now_let_in = 0) override {
    held = now_held;
    let_in += now_let_in;
  }
  std::vector<BrokerEvent> take_events() override { return std::exchange(events_, {}); }

  mutable int checks = 0;  ///< number of calls to is_connected()

  // ---- actions of the test ---------------------------------------------------------------------
  void acknowledge_next() {
    ASSERT_FALSE(open_.empty());
    const Publication publication = open_.front();
    open_.pop_front();
    take(publication);
  }
  void acknowledge_all() {
    while (!open_.empty()) acknowledge_next();
  }
  void refuse_next(int reason_code) {
    ASSERT_FALSE(open_.empty());
    events_.push_back(DeliveryFailed{open_.front().id, reason_code, "refused"});
    open_.pop_front();
  }
  void lose(int reason_code = 0) {
    up_ = false;
    open_.clear();
    events_.push_back(Lost{"connection closed", reason_code});
  }
  /// Breaks the connection without an event.
  void vanish() {
    up_ = false;
    open_.clear();
  }
  void answer_subscription(const std::string& filter, const std::string& why_not) {
    events_.push_back(Subscribed{filter, why_not.empty(), why_not});
  }
  void send(Message message) { events_.push_back(std::move(message)); }

  // ---- observations of the test ----------------------------------------------------------------
  std::size_t open() const { return open_.size(); }
  bool up() const { return up_; }
  /// Returns the payloads published on this topic, acknowledged or not.
  std::vector<std::string> on(const std::string& topic) const {
    std::vector<std::string> payloads;
    for (const Publication& p : log)
      if (p.topic == topic) payloads.push_back(p.payload);
    return payloads;
  }

  bool reachable = true;
  bool session_present = false;  ///< it has kept the session
  bool answers = true;           ///< an unreachable broker refuses instead of staying silent
  bool acknowledges = true;
  bool acknowledges_qos0 = false;  ///< even if it acknowledges nothing else
  bool fails = false;              ///< every publish fails without an event from the broker
  bool finds_out = true;           ///< a publish detects the lost connection
  bool believes = false;           ///< claims to be connected, whatever the truth
  bool confirms = true;            ///< answers SUBSCRIBE with SUBACK
  bool echoes = false;             ///< delivers published messages to matching subscriptions
  bool refuses_states = false;     ///< refuses all subscriptions except to commands
  std::string refusal;             ///< the error in SUBACK; empty: granted
  std::string refuses_topic;       ///< part of the topics that it refuses for a time
  bool acknowledgements_awaited = true;
  bool held = false;
  std::size_t let_in = 0;  ///< messages let in while held, in total
  std::uint32_t receive_maximum = 20;
  std::uint32_t maximum_packet = 1 << 28;

  std::vector<std::size_t> connects;
  std::uint16_t sends_ahead = 0;  ///< as set by the last connect
  int disconnects = 0;
  bool left_with_will = false;  ///< the last disconnect asked for the last will
  std::vector<MqttConfig> used;
  std::vector<Publication> log;    ///< everything published, in order
  std::vector<Publication> taken;  ///< acknowledged ones
  std::vector<std::string> order;  ///< subscriptions, and topics of acknowledged publishes
  std::set<std::string> filters;
  std::size_t most_open = 0;

 private:
  void take(const Publication& publication) {
    taken.push_back(publication);
    order.push_back(publication.topic);
    events_.push_back(Delivered{publication.id});
    if (!echoes || !is_subscribed(publication.topic)) return;
    Message message;
    message.topic = publication.topic;
    message.payload = publication.payload;
    message.retained = publication.retain == Retain::yes;
    events_.push_back(std::move(message));
  }
  /// The agent's filters end in a literal level, with at most a "+" before it.
  bool is_subscribed(const std::string& topic) const {
    const std::size_t leaf = topic.rfind('/');
    const std::size_t device = topic.rfind('/', leaf - 1);
    return filters.contains(topic) ||
           filters.contains(topic.substr(0, device) + "/+" + topic.substr(leaf));
  }

  bool up_ = false;
  std::deque<Publication> open_;
  std::vector<BrokerEvent> events_;
};

}  // namespace fxagent::test
