// Reports to the service manager while the agent runs. Feeds the watchdog while field, uplink
// and pair give signs of life, and sends a status line. Time is an argument. Main thread.
#pragma once

#include <chrono>
#include <functional>
#include <optional>
#include <string>

#include "agent/process/heartbeats.h"

namespace fxagent {

class ServiceReports final {
 public:
  using Time = std::chrono::steady_clock::time_point;
  /// Interval of checking the status, which is sent if it has changed.
  static constexpr std::chrono::seconds kStatusEvery{10};
  /// Interval of sending the same status again.
  static constexpr std::chrono::seconds kSameStatusEvery{60};

  struct Sources {
    /// Requests a sign of life from field and uplink; does not wait for it.
    std::function<void()> ask;
    /// Returns the status; empty: not known. May block briefly.
    std::function<std::string()> status;
  };

  /// `signs` outlives the object. The environment names the service manager's socket and the
  /// interval.
  ServiceReports(Heartbeats& signs, Sources sources, Time now);

  /// Returns the time of the next tell(); nullopt: no service manager listens.
  std::optional<Time> next() const;
  /// Does what is due. If one of them hangs, the watchdog is not fed; the log and the status name
  /// it.
  void tell(Time now);

 private:
  void feed(Time now);
  void notify_status(Time now);

  Heartbeats& signs_;
  const Sources sources_;
  const std::optional<std::chrono::nanoseconds> feed_every_;  ///< nullopt: no watchdog is set
  std::optional<Time> feed_at_;
  std::optional<Time> status_at_;  ///< nullopt: no service manager listens
  std::string stands_still_;       ///< as last reported; empty: none hangs
  std::string status_;             ///< as last sent
  Time sent_at_{};                 ///< time of the last send
};

}  // namespace fxagent
