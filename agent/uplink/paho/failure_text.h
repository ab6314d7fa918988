// Describes in words why a connection, a message or a subscription failed, and what to do. Paho
// gives a number for most of it; socket_calls and Paho's trace have the rest.
#pragma once

#include <mqtt/properties.h>
#include <mqtt/token.h>

#include <chrono>
#include <string>

#include "agent/config/model.h"
#include "agent/uplink/paho/setting_names.h"

namespace fxagent {

struct ConnectFaults;

/// Paho gives up an attempt to connect after this time.
inline constexpr std::chrono::seconds kPahoConnectTimeout{10};

/// Limits Paho's trace to errors. By default Paho records each of its function calls and packets in
/// a list in memory that is never read, which is a sixth of its cost per message. Levels above
/// ERROR would not prevent it.
void trace_errors_alone() noexcept;
/// Makes Paho's threads record all their TLS failures; after trace_errors_alone(), only errors.
void trace_tls_failures() noexcept;
/// Forgets the TLS failure that the calling thread has recorded. Otherwise the next failed connect
/// would give it as its reason.
void forget_tls_failure() noexcept;

/// True if Paho ended a call because the connection is gone.
bool is_disconnected(int return_code);
/// Describes a broker's DISCONNECT.
std::string disconnect_text(const mqtt::properties& properties, int code);
/// Describes a connection found closed. Call on the thread that found it.
std::string closed_text();

/// Describes one connection's failures. Immutable. Call on the thread of Paho that reports one.
class FailureText final {
 public:
  /// `config` outlives the object. `names` are those of its settings. `version` is Paho's number of
  /// the MQTT version. `tls`: the server is one by TLS.
  FailureText(const MqttConfig& config, const SettingNames& names, int version, bool tls);

  /// Returns the MQTT 5 reason code of a refusal; 0 if it is not the broker's. Paho puts the code
  /// of a CONNACK into the return code, any other into the reason code.
  int refusal_of(const mqtt::token& token) const;
  /// Describes a failed attempt to connect that began at `since`.
  std::string of_connect(const mqtt::token& token,
                         std::chrono::steady_clock::time_point since) const;
  std::string of_publish(const mqtt::token& token) const;
  std::string of_subscribe(const mqtt::token& token) const;
  /// Describes the refusal of a topic by an MQTT 5 reason code.
  std::string of_refused_topic(int reason_code) const;

 private:
  std::string of_tls(const ConnectFaults& faults,
                     std::chrono::steady_clock::time_point since) const;
  std::string of_plain(const ConnectFaults& faults,
                       std::chrono::steady_clock::time_point since) const;
  std::string cut_after_handshake() const;
  std::string set_certificate() const;

  const MqttConfig& config_;
  const SettingNames names_;
  const int version_;
  const bool tls_;
};

}  // namespace fxagent
