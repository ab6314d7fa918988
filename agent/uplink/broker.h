// PORT: an MQTT broker, with one connection at a time. Every operation is asynchronous; the uplink
// thread collects its outcome as an event. Implementations: PahoBroker and the tests' FakeBroker.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "agent/config/model.h"
#include "agent/handover/command_message.h"
#include "protocol/value/bytes.h"

namespace fxagent {

enum class Retain : std::uint8_t { no, yes };

struct Publication {
  std::uint64_t id = 0;  ///< chosen by the caller; returned in Delivered or DeliveryFailed
  std::string topic{};
  std::string payload{};
  int qos = 1;
  Retain retain = Retain::no;
  Bytes correlation{};  ///< MQTT 5 correlation data; empty: none
};
/// Returns a retained message, with QoS 1. An empty payload clears the topic.
inline Publication retained(std::string topic, std::string payload = {}) {
  return {.topic = std::move(topic), .payload = std::move(payload), .retain = Retain::yes};
}

struct Subscription {
  std::string filter;
  /// MQTT 5 No Local: the broker does not send back messages that this client publishes or has
  /// published before. This also hides the client's own retained messages.
  bool no_local = false;
  int qos = 1;  ///< 0: the broker keeps none of its messages while the session is not connected
};

// ---- events

/// The connection is up. Holds the limits that an MQTT 5 broker announced.
struct Connected {
  bool session_present = false;
  std::uint32_t receive_maximum = 65535;  ///< unacknowledged publishes that the broker accepts
  std::uint32_t maximum_packet = std::numeric_limits<std::uint32_t>::max();  ///< bytes
};
/// connect() failed. `text` gives the reason and contains no secrets.
struct ConnectFailed {
  std::string text;
};
/// An established connection is gone: it was closed, or the broker sent a DISCONNECT. Posted once
/// per connection. Publications not yet Delivered will not be Delivered.
struct Lost {
  std::string text;
  int reason_code = 0;  ///< from the broker's MQTT 5 DISCONNECT; 0: it sent none
};
/// disconnect() is complete.
struct Disconnected {};
/// A message on one of the subscriptions.
struct Message : MessageProperties {
  std::string topic;
  /// Cut after kMaxMessageBytes + 1 bytes, unless the broker was created with another limit; on a
  /// topic of remote configs after kMaxDesiredBytes + 1.
  std::string payload;
  int qos = 1;
};
/// QoS 1: the broker sent a PUBACK. QoS 0: the message was handed to the socket.
struct Delivered {
  std::uint64_t id = 0;
};
struct DeliveryFailed {
  std::uint64_t id = 0;
  /// From the MQTT 5 PUBACK. 0: the library rejected the message, and the broker did not answer.
  int reason_code = 0;
  std::string text;
};
struct Subscribed {
  std::string filter;
  bool granted = false;
  std::string text;  ///< reason of a refusal
};
/// The uplink took its events too slowly, and `count` messages were discarded. QoS 1 messages are
/// among them only if hold_messages() was not used or had no effect.
struct MessagesDropped {
  std::uint64_t count = 0;
};

using BrokerEvent = std::variant<Connected, ConnectFailed, Lost, Disconnected, Message, Delivered,
                                 DeliveryFailed, Subscribed, MessagesDropped>;

/// Fate of the last will at the broker when the agent disconnects.
enum class Will : std::uint8_t { discarded, published };

/// Uplink thread only. No function blocks or throws; every outcome is an event.
class Broker {
 public:
  virtual ~Broker() = default;

  /// Sets the servers, names and secrets for the next connect().
  virtual void use(const MqttConfig& mqtt) = 0;
  /// Abandons any earlier connection and connects to server `index` of the config. Posts Connected
  /// or ConnectFailed. On MQTT 5 `receive_maximum` is sent to the broker (section 3.1.2.11.3);
  /// 3.1.1 has no equivalent.
  virtual void connect(std::size_t index, std::uint16_t receive_maximum) = 0;
  /// Disconnects, and posts Disconnected. Sends no DISCONNECT if the will is to be published.
  virtual void disconnect(Will will = Will::discarded) = 0;
  /// True if the library reports the connection as up. If false, Lost has been posted or will be,
  /// unless the library failed to report the loss.
  virtual bool is_connected() const = 0;
  /// Posts Delivered or DeliveryFailed, or neither if Lost comes first.
  virtual void publish(Publication publication) = 0;
  /// Subscribes and, on MQTT 5, asks for Retain As Published. Posts Subscribed, or nothing if the
  /// broker does not answer.
  virtual void subscribe(Subscription subscription) = 0;
  virtual void unsubscribe(const std::string& filter) = 0;
  /// Sets whether an acknowledgement notifies the uplink at once, as it does by default. Otherwise
  /// the next take_events() returns it.
  virtual void await_acknowledgements(bool awaited) = 0;
  /// Holds messages back in the network, and with them everything that follows on the same
  /// connection, acknowledgements included. No message is lost, but a few may still arrive. Each
  /// connection begins without a hold. If `let_in` is not 0, that many messages and the packets
  /// between them are let in before the hold begins.
  virtual void hold_messages(bool held, std::size_t let_in = 0) = 0;

  /// Returns the events since the last call, in order; only those of the current connection.
  virtual std::vector<BrokerEvent> take_events() = 0;
};

// ---- limits, topics and codes

/// Longest payload that the agent processes. One more byte is kept, to show that there was more.
inline constexpr std::size_t kMaxMessageBytes = 65536;
/// Topics below the agent's base: a remote config, and the report on it.
inline constexpr std::string_view kDesiredTopic = "/config/desired";
inline constexpr std::string_view kReportedTopic = "/config/reported";
/// Number of messages that a broker may send ahead of our acknowledgements. Small, because the
/// PUBACKs of our own messages queue behind them.
inline constexpr std::uint16_t kReceiveMaximum = 10;

// Reason codes of a PUBACK (MQTT 5, section 3.4.2.1) that a repetition cannot cure.
inline constexpr int kTopicNameInvalid = 0x90;
inline constexpr int kPacketTooLarge = 0x95;
inline constexpr int kPayloadFormatInvalid = 0x99;
/// True if the broker would refuse the message again at any later time.
inline bool is_final(int reason_code) {
  return reason_code == kTopicNameInvalid || reason_code == kPacketTooLarge ||
         reason_code == kPayloadFormatInvalid;
}
/// Returns the code as the standard writes it; "none" if the failure has no code, as on 3.1.1.
inline std::string hex_code(int reason_code) {
  return reason_code == 0 ? "none" : "0x" + hex_text(static_cast<std::uint64_t>(reason_code), 2);
}
/// MQTT 5, section 3.14.2.1: another client has connected with our client id.
inline constexpr int kSessionTakenOver = 0x8E;

/// Returns the approximate memory use of a message, in bytes.
inline std::size_t bytes_of(const Message& message) {
  return sizeof(message) + message.topic.size() + message.payload.size() +
         message.response_topic.size() + message.correlation.size();
}

}  // namespace fxagent
