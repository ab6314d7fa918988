// Interface to a profile: the form in which an outlet publishes the plant, and the commands that it
// hears. agent.cpp makes the profiles of the config.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "agent/config/config_difference.h"
#include "agent/config/model.h"
#include "agent/handover/command_message.h"
#include "agent/handover/telemetry.h"
#include "agent/steady_time.h"
#include "agent/uplink/broker.h"
#include "agent/uplink/payload/payload.h"

namespace fxagent {

class JitteredBackoff;
class Outgoing;

/// Takes a command that a profile has heard. Empty: the broker may not send commands.
using RelayCommand = std::function<void(RelayedCommand command)>;

/// Uplink thread only. Calls, in order: begin(); for each connection last_will(), subscriptions()
/// and connection_began(), then subscribed(), hear(), due() and the samples as they come, and
/// connection_ended(). Those of the last group come at any time after begin().
class Profile : public SamplePayload {
 public:
  /// Called once, before messages are sent or received. Both outlive the profile's use: it may send
  /// messages itself in connection_began() and due().
  virtual void begin(Outgoing& /*outgoing*/, JitteredBackoff& /*backoff*/) {}
  /// True if the broker shall publish the last will although the connection is closed on purpose.
  virtual bool wants_will_at_disconnect() const { return false; }
  /// False: the profile has no samples. No function of SamplePayload is called then.
  virtual bool wants_samples() const { return true; }

  // ---- a connection

  /// Returns the message that the broker publishes if the connection ends without a clean end.
  /// Called before each attempt to connect. An empty topic: no last will.
  virtual Publication last_will() { return {}; }
  /// Returns what to subscribe to in each connection.
  virtual std::vector<Subscription> subscriptions() const = 0;
  virtual void connection_began(const Connected& connected) = 0;
  /// The broker has granted or refused one of the subscriptions. No answer within 1 s, or before a
  /// stop, counts as a refusal. The outlet repeats it until it is granted.
  virtual void subscribed(const Subscribed& /*event*/) {}
  /// Processes a message on one of the subscriptions.
  virtual void hear(const Message& message) = 0;
  /// Returns messages that go before samples, such as births and states; empty: none are due.
  /// Called while connected, until it returns none. `utc_ms` is the current calendar time.
  virtual std::vector<Publication> due(SteadyTime now, std::int64_t utc_ms) = 0;
  /// The broker or the library has refused messages of due().
  virtual void due_was_refused() {}
  /// Returns the time by which due() has something.
  virtual SteadyTime next_wake() const { return SteadyTime::max(); }
  /// False: no samples may be sent now. They wait as history.
  virtual bool is_ready() const { return true; }
  /// True, once, if the session must leave this server and go to the next one.
  virtual bool take_server_change() { return false; }
  /// Returns the last messages before the connection is closed on purpose.
  virtual std::vector<Publication> farewell(std::int64_t /*utc_ms*/) { return {}; }
  virtual void connection_ended() = 0;

  // ---- connected or not

  virtual void device_state(const DeviceStatus& /*status*/) {}
  /// A sample has come from the field. It follows by sample(), or later as history.
  virtual void saw(const Telemetry& /*sample*/, SteadyTime /*now*/) {}
  /// Returns the results of commands since the last call. They go after samples that were read
  /// before, repeatedly until the broker has acknowledged them, also in later connections.
  virtual std::vector<Publication> take_results() { return {}; }
  /// Adapts to a config change, which the config already contains.
  virtual void change(const ConfigChange& change) = 0;
};

// What profiles have in common when they hear a command. Pure, except for the log.

/// Logs that the message is not carried out, and why.
void ignore_command(const Message& message, const std::string& note);

/// True if a message from this broker only clears a retained topic, or may do so: MQTT 3.1.1 does
/// not pass on the retain flag of a live message.
bool only_clears(const Message& message, const MqttConfig& mqtt);

/// True, and logged, if a link has this name. Only the broker of `mqtt` may send it commands.
bool is_for_link(const Config& config, const Message& message, std::string_view name);

/// Returns the command for a device, with the properties of the message and without its payload.
/// `sender` is for the audit.
RelayedCommand relayed_command(const Message& message, std::string device, std::string sender);

/// Returns the command that writes `value`, which is JSON, to a tag.
std::string write_command(std::string_view id, std::string_view tag, std::string_view value);

}  // namespace fxagent
