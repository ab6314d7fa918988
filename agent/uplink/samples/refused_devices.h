// Devices whose samples the broker refuses for a time, or the library rejects: each has a pause
// that grows with every refusal. Uplink thread. Time is an argument.
#pragma once

#include <functional>
#include <map>
#include <optional>
#include <string>

#include "agent/steady_time.h"
#include "agent/uplink/broker.h"
#include "agent/uplink/jittered_backoff.h"

namespace fxagent {

class RefusedDevices final {
 public:
  /// `backoff` outlives the object.
  explicit RefusedDevices(JitteredBackoff& backoff) : backoff_(backoff) {}

  /// Ends all pauses: a new connection has begun.
  void clear() { pauses_.clear(); }
  /// The broker refused a message with samples of the device. Begins a pause, or goes on with it.
  void refused(const std::string& device, const DeliveryFailed& event, SteadyTime now);
  /// The broker accepted a message that was sent at `since`. Ends the device's pause, unless the
  /// message was sent before the refusal.
  void accepted(const std::string& device, SteadyTime since);

  bool may_send(const std::string& device, SteadyTime now) const;
  /// Returns the MQTT reason code with which the broker refuses the device's samples; nullopt: it
  /// accepts them.
  std::optional<int> reason(const std::string& device) const;
  /// Returns the next end of a pause of a device for which `matters` is true.
  SteadyTime next_end(SteadyTime now, const std::function<bool(const std::string&)>& matters) const;

 private:
  struct Pause {
    SteadyTime since{};  ///< of the last refusal
    SteadyTime until{};
    int failures = 0;
    int reason_code = 0;  ///< 0: the library rejects the samples
  };

  JitteredBackoff& backoff_;
  std::map<std::string, Pause> pauses_;  ///< by device name, as in the store
};

}  // namespace fxagent
