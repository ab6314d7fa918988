// Detects if field and uplink still run, for the watchdog of the service manager. Both get a
// request for a sign of life, and give one only by doing their usual work.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>

namespace fxagent {

class Heartbeats final {
 public:
  /// Called by the two threads in each round of their loops.
  void field_went_on() noexcept { ++field_; }
  void uplink_went_on() noexcept { ++uplink_; }

  /// Returns the threads without a sign since the last empty result: "field", "uplink" or "field
  /// and uplink"; empty: none. Call on one thread.
  std::string stands_still();

 private:
  std::atomic<std::uint64_t> field_ = 0;
  std::atomic<std::uint64_t> uplink_ = 0;
  std::uint64_t field_then_ = 0;
  std::uint64_t uplink_then_ = 0;
};

}  // namespace fxagent
