// The port to an MQTT broker: one connection at a time, everything asynchronous, news taken by the
// uplink thread. Two things implement it: PahoBroker and the tests' FakeBroker.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "agent/config/config.h"
#include "agent/messages.h"
#include "protocol/bytes.h"

namespace fxagent {

enum class Retain : std::uint8_t { no, yes };

struct Publication {
  std::uint64_t id = 0;  ///< the caller's; comes back in Delivered or DeliveryFailed
  std::string topic;
  std::string payload;
  int qos = 1;
  Retain retain = Retain::no;
  Bytes correlation;  ///< MQTT 5 correlation data; empty: none
};

/// What the broker publishes for us, with QoS 1, when we vanish.
struct Will {
  std::string topic;
  std::string payload;
  Retain retain = Retain::yes;
};

/// The connection is up. What the broker can take, where it said so (MQTT 5).
struct Connected {
  bool session_present = false;
  std::uint32_t receive_maximum = 65535;  ///< unacknowledged publishes it accepts
  std::uint32_t maximum_packet = std::numeric_limits<std::uint32_t>::max();  ///< bytes
};
/// connect() came to nothing. `text` says why, without any secret.
struct ConnectFailed {
  std::string text;
};
/// The connection that was up is gone: closed, ended by the broker's DISCONNECT, or found gone by a
/// call of ours. Told once. Nothing that was not Delivered will be any more.
struct Lost {
  std::string text;
  int reason_code = 0;  ///< of the broker's MQTT 5 DISCONNECT; 0: it sent none
};
/// MQTT 5, section 3.14.2.1: another client has come with our client id.
inline constexpr int kSessionTakenOver = 0x8E;
/// disconnect() is done.
struct Disconnected {};
struct Message : MessageProperties {
  std::string topic;
  /// Cut off after kMaxMessageBytes + 1, unless the broker was told otherwise; on a topic of
  /// configs after kMaxDesiredBytes + 1.
  std::string payload;
  int qos = 1;
};
/// What a message takes in memory, roughly.
inline std::size_t bytes_of(const Message& message) {
  return sizeof(message) + message.topic.size() + message.payload.size() +
         message.response_topic.size() + message.correlation.size();
}
/// QoS 1: the PUBACK came. QoS 0: handed to the socket.
struct Delivered {
  std::uint64_t id = 0;
};
struct DeliveryFailed {
  std::uint64_t id = 0;
  /// Of the MQTT 5 PUBACK; 0: the library refused it, and the broker has not said a word.
  int reason_code = 0;
  std::string text;
};
struct Subscribed {
  std::string filter;
  bool granted = false;
  std::string text;  ///< why not
};
/// The uplink did not take its news fast enough: so many messages were thrown away. Of what was
/// published with QoS 1 only where hold_messages() was not used or not heeded.
struct MessagesDropped {
  std::uint64_t count = 0;
};

using BrokerEvent = std::variant<Connected, ConnectFailed, Lost, Disconnected, Message, Delivered,
                                 DeliveryFailed, Subscribed, MessagesDropped>;

/// Longest payload that the agent looks at; one more byte tells that there was more.
inline constexpr std::size_t kMaxMessageBytes = 65536;

/// Behind the agent's base: a remote config, and what became of it.
inline constexpr std::string_view kDesiredTopic = "/config/desired";
inline constexpr std::string_view kReportedTopic = "/config/reported";

/// How many messages a broker may send ahead of our acknowledgements. Few, since the PUBACKs of our
/// own messages come behind them.
inline constexpr std::uint16_t kReceiveMaximum = 10;

struct Subscription {
  std::string filter;
  /// MQTT 5 No Local: what this client publishes, now or earlier, does not come back. Retained
  /// messages of its own are then hidden too.
  bool no_local = false;
};

/// Uplink thread only. No function blocks or throws; every outcome is an event.
class Broker {
 public:
  virtual ~Broker() = default;

  /// Servers, names and secrets are these from the next connect() on.
  virtual void use(const MqttConfig& mqtt) = 0;

  /// Gives up any earlier connection and asks for one to server `index` of the config.
  /// Then Connected or ConnectFailed. `receive_maximum` is told to the broker (MQTT 5, section
  /// 3.1.2.11.3); 3.1.1 has no such thing.
  virtual void connect(std::size_t index, std::uint16_t receive_maximum) = 0;
  /// A clean goodbye, so that the broker keeps the last will to itself. Then Disconnected.
  virtual void disconnect() = 0;
  /// Whether the library under it believes that the connection stands. Where it does not, Lost is
  /// there or on its way, unless the library forgot to tell.
  virtual bool is_connected() const = 0;
  /// Then Delivered or DeliveryFailed, or neither where Lost comes first; Lost where the connection
  /// is found gone.
  virtual void publish(Publication publication) = 0;
  /// QoS 1, Retain As Published on MQTT 5. Then Subscribed, or nothing where the broker does not
  /// answer.
  virtual void subscribe(Subscription subscription) = 0;
  virtual void unsubscribe(const std::string& filter) = 0;

  /// Whether an acknowledgement is news of its own from now on. If not, it is found with the next
  /// take_events(): the caller does not wait for it. At the start it is.
  virtual void await_acknowledgements(bool awaited) = 0;

  /// Whether messages are to stay in the network for now, and whatever comes after them on the same
  /// connection, acknowledgements too. None is lost by it; a few may come all the same. Each
  /// connection begins without. With `let_in` so many of them come before the rest is held, and
  /// what is between and behind them.
  virtual void hold_messages(bool held, std::size_t let_in = 0) = 0;

  /// What happened since the last call, in order; only of the present connection.
  virtual std::vector<BrokerEvent> take_events() = 0;
};

}  // namespace fxagent
