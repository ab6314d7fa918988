// The MQTT session of a consumer: MQTT 5, a session that outlives the connection. One thread.
//
// Acknowledges messages only in acknowledge(). libmosquitto queues the PUBACK when it has read a
// message, and in this mode it sends its queue only when the caller writes. So this class does not
// write between the arrival of a message and acknowledge(). Paho cannot do that: it sends the
// PUBACK before it calls back.
#pragma once

#include <mosquitto.h>

#include <chrono>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "agent/history/batch.h"

namespace fxagent::history {

struct SubscriberConfig {
  std::string host = "127.0.0.1";
  int port = 1883;
  bool tls = false;
  std::string ca_file;  ///< empty: the system's
  std::string cert_file;
  std::string key_file;
  std::string username;
  std::string password;
  std::string client_id;  ///< of this consumer alone
  std::string root = "fx";
  std::string group;          ///< of the shared subscription; empty: not shared
  int receive_maximum = 100;  ///< most messages of one batch
  int keep_alive_s = 30;      ///< at least 5
  std::uint32_t session_expiry_s = 604'800;
};

class Subscriber final {
 public:
  /// receive() returns early when `stop` is readable. Throws std::runtime_error if the config
  /// cannot be used, such as a certificate that cannot be read.
  Subscriber(const SubscriberConfig& config, int stop);
  ~Subscriber();
  Subscriber(const Subscriber&) = delete;
  Subscriber& operator=(const Subscriber&) = delete;

  /// Connects, or discards the present connection and connects again. Blocks until the TCP
  /// connection stands. Returns an empty text, or the reason of the failure.
  std::string connect();
  /// Waits for messages, up to `wait` but at most 1 s. Returns those that have arrived; stops at
  /// `receive_maximum` messages, or when their payloads reach 4 MiB. Call acknowledge() before the
  /// next call if there are any.
  const std::vector<Message>& receive(std::chrono::milliseconds wait);
  /// Acknowledges all messages of the last receive().
  void acknowledge();
  /// Sends a PINGREQ if one is due. Takes and acknowledges no message. Call it at least once a
  /// second while messages are unacknowledged.
  void keep_alive();
  /// Ends the connection. The broker keeps the session. Does nothing while messages are
  /// unacknowledged: the destructor closes the connection, and the broker sends them again.
  void disconnect();

  bool is_connected() const { return connected_; }
  /// True once the broker has confirmed the subscriptions of this connection.
  bool is_subscribed() const { return subscribed_; }
  /// True if the broker had kept the session of this client id.
  bool is_resumed() const { return resumed_; }
  /// Reason why the connection was lost, or the subscription refused.
  const std::string& fault() const { return fault_; }

 private:
  struct Destroy {
    void operator()(mosquitto* client) const { mosquitto_destroy(client); }
  };

  void on_connect(int reason, bool resumed, const mosquitto_property* properties);
  void on_subscribe(int count, const int* granted);
  void on_disconnect(int reason);
  void check(int status);
  void write();
  bool read_once(std::chrono::milliseconds wait);

  const SubscriberConfig config_;
  const int stop_;
  std::unique_ptr<mosquitto, Destroy> client_;
  std::vector<Message> messages_;
  bool connected_ = false;
  bool accepted_ = false;  // the broker has answered CONNECT
  bool subscribed_ = false;
  bool resumed_ = false;
  /// True if the last packet that libmosquitto began to send was sent as a whole.
  bool between_packets_ = false;
  std::chrono::seconds ping_interval_{};
  std::chrono::steady_clock::time_point next_ping_{};
  std::string fault_;
};

}  // namespace fxagent::history
