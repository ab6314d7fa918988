// Broker over Eclipse Paho C++ 1.2. Paho stores nothing for us: it has no persistence, no offline
// buffer and no reconnect of its own. The publisher owns delivery and retries.
//
// Each connection has its own Paho client: a client that is used again would send what was left in
// its queue when the last connection broke, after newer values.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "agent/config/model.h"
#include "agent/uplink/broker.h"
#include "agent/uplink/paho/setting_names.h"

namespace fxagent {

class PahoConnection;
class PahoInbox;

/// Returns the last will of the connection about to be made. The broker publishes it with QoS 1
/// when the connection ends without a DISCONNECT. Without a topic there is none.
using MakeWill = std::function<Publication()>;

/// Uplink thread. Paho's own threads only put events into the inbox and call `notify`.
class PahoBroker final : public Broker {
 public:
  /// `make_will` is called from connect(); empty: no last will. `notify` is called on Paho's
  /// threads when there are events; it must not block or throw, and may be called until the
  /// destructor returns. A message's payload is cut after `max_payload` + 1 bytes. The broker keeps
  /// subscriptions and QoS 1 messages of a lost connection for `keep_session`, on MQTT 5 only; see
  /// Connected::session_present. `names` are those of the settings of `config` in error texts.
  PahoBroker(const MqttConfig& config, MakeWill make_will, std::function<void()> notify,
             std::size_t max_payload = kMaxMessageBytes, std::chrono::seconds keep_session = {},
             const SettingNames& names = {});
  /// Waits up to 2 s for an open connection to close.
  ~PahoBroker() override;

  void use(const MqttConfig& mqtt) override { config_ = mqtt; }
  /// Reads the password again at each call: a changed secret needs no restart. Always verifies host
  /// name and chain of a TLS server's certificate.
  void connect(std::size_t index, std::uint16_t receive_maximum) override;
  void disconnect(Will will = Will::discarded) override;
  bool is_connected() const override;
  void publish(Publication publication) override;
  void subscribe(Subscription subscription) override;
  void unsubscribe(const std::string& filter) override;
  void await_acknowledgements(bool awaited) override;
  void hold_messages(bool held, std::size_t let_in = 0) override;
  std::vector<BrokerEvent> take_events() override;

 private:
  void retire();
  void found_closed();

  MqttConfig config_;
  const MakeWill make_will_;
  const std::size_t max_payload_;
  const std::chrono::seconds keep_session_;
  const SettingNames names_;
  /// Owned by this and every connection: a callback may still run when its connection is retired.
  std::shared_ptr<PahoInbox> inbox_;
  std::uint64_t connections_ = 0;  ///< number of the current connection, or of the last
  std::unique_ptr<PahoConnection> connection_;
  /// A call found the connection closed; unless Paho's callback gives the reason within 1 s, the
  /// loss is reported without one.
  std::optional<std::chrono::steady_clock::time_point> closed_since_;
  struct Retired {
    std::unique_ptr<PahoConnection> connection;
    std::chrono::steady_clock::time_point since;
  };
  /// Abandoned connections, kept for at least 1 s each: Paho's threads have surely left then.
  std::vector<Retired> retired_;
};

}  // namespace fxagent
