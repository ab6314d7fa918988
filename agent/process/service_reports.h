// What the service manager is told while the agent runs: that it goes on, as long as field and
// uplink give signs of life, and how it is, in one line. Time is an argument. Main thread.
#pragma once

#include <chrono>
#include <functional>
#include <optional>
#include <string>

#include "agent/process/signs_of_life.h"

namespace fxagent {

class ServiceReports final {
 public:
  using Time = std::chrono::steady_clock::time_point;
  /// The status is looked at so often, and told where it is another one.
  static constexpr std::chrono::seconds kStatusEvery{10};
  /// And so often where it is the same.
  static constexpr std::chrono::seconds kSameStatusEvery{60};

  struct Sources {
    /// Asks field and uplink for a sign of life; does not wait for them.
    std::function<void()> ask;
    /// The status; empty: not known. May wait a moment.
    std::function<std::string()> status;
  };

  /// `signs` outlives it. Who is to be told, and how often, is in the environment.
  ServiceReports(SignsOfLife& signs, Sources sources, Time now);

  /// When tell() has something to do; nothing: nobody wants to be told.
  std::optional<Time> next() const;
  /// What is due. Where field or uplink stands still the watchdog is not fed, and the log and the
  /// status say which.
  void tell(Time now);

 private:
  void feed(Time now);
  void tell_status(Time now);

  SignsOfLife& signs_;
  const Sources sources_;
  const std::optional<std::chrono::nanoseconds> feed_every_;  ///< nothing: there is no watchdog
  std::optional<Time> feed_at_;
  std::optional<Time> status_at_;  ///< nothing: nobody is told of it
  std::string stands_still_;       ///< as it was told; empty: nobody
  std::string status_;             ///< as it was told
  Time told_at_{};                 ///< when
};

}  // namespace fxagent
