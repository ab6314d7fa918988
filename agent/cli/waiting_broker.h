// Connection to a broker for subcommands: the calling thread waits for its events.
#pragma once

#include <chrono>
#include <cstddef>

#include "agent/config/model.h"
#include "agent/file_handle.h"
#include "agent/steady_time.h"
#include "agent/uplink/paho/paho_broker.h"

namespace fxagent {

/// Wait for an answer of a broker: longer than the connect time-out of the MQTT library.
inline constexpr std::chrono::seconds kBrokerPatience{30};

/// A broker whose events the calling thread can wait for, together with the signals SIGINT and
/// SIGTERM, which end the wait. Create it before any other thread, because it blocks these signals.
class WaitingBroker final {
 public:
  /// Cuts the payload of a message after `max_payload` + 1 bytes. For `keep_session` and
  /// `names` see PahoBroker.
  WaitingBroker(const MqttConfig& config, std::size_t max_payload, const SettingNames& names,
                std::chrono::seconds keep_session = {});
  WaitingBroker(const WaitingBroker&) = delete;
  WaitingBroker& operator=(const WaitingBroker&) = delete;

  Broker& broker() { return broker_; }

  /// Waits for an event, a signal or the time. Returns false after a signal.
  bool wait_until(SteadyTime deadline);

 private:
  FileHandle news_;
  FileHandle signals_;
  PahoBroker broker_;  // last: its callbacks use the others
};

}  // namespace fxagent
