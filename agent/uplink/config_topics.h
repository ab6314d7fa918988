// The topics of remote configs: {base}/config/desired, which is received, and
// {base}/config/reported, which is published. Uplink thread. Time is an argument.
#pragma once

#include <functional>
#include <optional>
#include <string>

#include "agent/config/model.h"
#include "agent/steady_time.h"
#include "agent/store/guarded_store.h"
#include "agent/uplink/broker.h"
#include "agent/uplink/retained/retained_state.h"
#include "agent/uplink/session/session.h"
#include "agent/uplink/shutdown.h"

namespace fxagent {

class ConfigTopics final {
 public:
  /// Receives each document of {base}/config/desired, and each change of the connection, from the
  /// publisher's step().
  struct Listener {
    std::function<void(std::string payload)> desired;
    std::function<void(bool connected, SteadyTime now)> connection;
  };

  /// All references outlive the object. `store` gets the audit records; null: no store.
  ConfigTopics(const Config& config, const Session& session, const Shutdown& shutdown,
               RetainedState& retained, GuardedStore* store);

  void set_listener(Listener listener);
  /// Sets the text of {base}/config/reported, which is published again after each connect. Empty:
  /// the topic is cleared once, and nothing is published there. `audit` is the body of an audit
  /// record; empty: none.
  void report(std::string text, std::string audit);
  /// Returns the report to publish.
  Publication take_report();

  /// Passes a document to the listener, if remote configs are on.
  void hear(const std::string& payload) const;
  void connection_began(SteadyTime now);
  void connection_ended(SteadyTime now);

 private:
  const Config& config_;
  const Session& session_;
  const Shutdown& shutdown_;
  RetainedState& retained_;
  GuardedStore* const store_;
  const std::string topic_;  ///< of the report
  Listener listener_;
  std::optional<std::string> report_;  ///< nullopt: no report yet
};

}  // namespace fxagent
