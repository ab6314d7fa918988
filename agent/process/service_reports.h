// Reports to the service manager while the agent runs. Feeds the watchdog while field, uplink
// and pair give signs of life, and sends a status line. Time is an argument. Main thread.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>

namespace fxagent {

/// Detects if the field, the uplink and the pair, if there is one, still run. Each gives a sign of
/// life only by doing its usual work; field and uplink get a request for it.
class Heartbeats final {
 public:
  explicit Heartbeats(bool has_pair = false) : threads_(has_pair ? kThreadCount : kPairThread) {}

  /// Called by the threads in each round of their loops.
  void field_went_on() noexcept { ++signs_[kFieldThread]; }
  void uplink_went_on() noexcept { ++signs_[kUplinkThread]; }
  void pair_went_on() noexcept { ++signs_[kPairThread]; }

  /// Returns the threads without a sign since the last empty result: for example "field
  /// and uplink"; empty: none. Call on one thread.
  std::string hanging_threads();

 private:
  enum Thread : std::uint8_t { kFieldThread, kUplinkThread, kPairThread, kThreadCount };

  const std::size_t threads_;  ///< that run; the pair is the last
  std::array<std::atomic<std::uint64_t>, kThreadCount> signs_{};
  std::array<std::uint64_t, kThreadCount> then_{};  ///< at the last empty result
};

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

  /// `signs` outlives the object. The environment has the service manager's socket and interval.
  ServiceReports(Heartbeats& signs, Sources sources, Time now);

  /// Returns the time of the next keep(); Time::max(): no service manager listens.
  Time next() const { return std::min(feed_at_, status_at_); }
  /// Does what is due. If a thread hangs, does not feed the watchdog, and names the thread in the
  /// log and the status.
  void keep(Time now);

 private:
  void feed(Time now);
  void notify_status(Time now);

  Heartbeats& signs_;
  const Sources sources_;
  const std::optional<std::chrono::nanoseconds> feed_every_;  ///< nullopt: no watchdog is set

  Time feed_at_ = Time::max();    ///< max: no watchdog is set
  Time status_at_ = Time::max();  ///< max: no service manager listens
  std::string hanging_threads_;   ///< as last reported; empty: none hangs
  std::string status_;            ///< as last sent
  Time sent_at_{};                ///< time of the last send
};

}  // namespace fxagent
