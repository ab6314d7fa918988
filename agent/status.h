// What is known of the agent at one moment: its counters, as the uplink and the field have them.
// The publisher makes it; health reads it, and whatever else is to show the agent's state reads it
// too. Plain data.
#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "agent/messages.h"

namespace fxagent {

/// Where every sample is.
struct SampleCounts {
  std::uint64_t collected = 0;
  std::uint64_t recovered = 0;
  std::uint64_t suppressed = 0;
  std::uint64_t queued = 0;
  std::uint64_t in_flight = 0;
  std::uint64_t stored = 0;
  std::uint64_t acknowledged = 0;
  std::uint64_t dropped = 0;
  std::uint64_t published = 0;  ///< sends, repeats included; no part of the balance
  bool miscounted = false;      ///< the field says that it made other than arrived

  /// Each sample is in exactly one place.
  bool balanced() const {
    return !miscounted && collected + recovered ==
                              suppressed + queued + in_flight + stored + acknowledged + dropped;
  }
};

/// By index in Config::devices, where a list has no other word.
struct AgentStatus {
  std::int64_t ts_ms = 0;
  std::string boot;
  std::string version;
  std::chrono::seconds uptime{0};
  std::string conflict;  ///< boot of another agent with the same id; empty: there is none
  SampleCounts samples;
  FieldHealth field;
  std::vector<std::uint64_t> dropped;  ///< samples, by index in Config::devices
  /// By the same index: the MQTT reason code, "0x97", for which the broker does not take the
  /// device's samples now; empty: it takes them.
  std::vector<std::string> refused;
  std::map<CommandStatus, std::uint64_t> commands;
  std::string store_state;      ///< "disk"; "memory" where there is none, or it cannot be written
  std::string store_set_aside;  ///< name of the damaged file of this run; empty: none
  std::uint64_t store_bytes = 0;
  std::uint64_t audit_records = 0;
  std::string audit_head;            ///< hash of the last of them; empty: there is no audit
  std::optional<double> hours_left;  ///< until the store is full at the present rate
  bool clock_synchronised = false;
  std::uint64_t rss_bytes = 0;
};

}  // namespace fxagent
