// Broker over Eclipse Paho C++ 1.2. Paho keeps nothing for us: no persistence, no buffer for times
// without a connection, no reconnect of its own; the publisher owns delivery and retries.
//
// Each connection has a Paho client of its own, since one that is used again would send what was
// left in its queue when the last connection broke, after newer values.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "agent/config/config.h"
#include "agent/uplink/broker.h"

namespace fxagent {

/// The last will of the connection that is about to be made.
using MakeWill = std::function<Will()>;

/// Functions: uplink thread. Paho's own threads only put events into the inbox and call `notify`.
class PahoBroker final : public Broker {
 public:
  /// `make_will` is called from connect(); empty: no last will. `notify` is called on Paho's
  /// threads whenever there is news; it must not block or throw, and may be called until the
  /// destructor returns. A message's payload is cut off one byte behind `max_payload`.
  PahoBroker(const MqttConfig& config, MakeWill make_will, std::function<void()> notify,
             std::size_t max_payload = kMaxMessageBytes);
  /// Waits up to 2 s for a connection that is up to be closed.
  ~PahoBroker() override;

  void use(const MqttConfig& mqtt) override { config_ = mqtt; }
  /// User name and password are read again at each call: a changed secret needs no restart. Host
  /// name and chain of a TLS server's certificate are always verified.
  void connect(std::size_t index, std::uint16_t receive_maximum) override;
  void disconnect() override;
  bool is_connected() const override;
  void publish(Publication publication) override;
  void subscribe(Subscription subscription) override;
  void unsubscribe(const std::string& filter) override;
  void await_acknowledgements(bool awaited) override;
  void hold_messages(bool held, std::size_t let_in = 0) override;
  std::vector<BrokerEvent> take_events() override;

 private:
  class Inbox;
  class Connection;

  void retire();

  MqttConfig config_;
  const MakeWill make_will_;
  const std::size_t max_payload_;
  /// Shared by this object and every connection: a callback may still be on its way when its
  /// connection has been given up.
  std::shared_ptr<Inbox> inbox_;
  std::uint64_t connections_ = 0;  ///< number of the present one, or the last
  std::unique_ptr<Connection> connection_;
  struct Retired {
    std::unique_ptr<Connection> connection;
    std::chrono::steady_clock::time_point since;
  };
  /// Given up, and kept for a second or more, until Paho's threads have surely left their
  /// callbacks.
  std::vector<Retired> retired_;
};

}  // namespace fxagent
