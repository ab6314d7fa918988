// Detects if the field, the uplink and the pair, if there is one, still run, for the watchdog of
// the service manager. Each gives a sign of life only by doing its usual work; field and uplink get
// a request for it.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>

namespace fxagent {

class Heartbeats final {
 public:
  explicit Heartbeats(bool has_pair = false) : has_pair_(has_pair) {}

  /// Called by the threads in each round of their loops.
  void field_went_on() noexcept { ++field_; }
  void uplink_went_on() noexcept { ++uplink_; }
  void pair_went_on() noexcept { ++pair_; }

  /// Returns the threads without a sign since the last empty result: for example "field
  /// and uplink"; empty: none. Call on one thread.
  std::string stands_still();

 private:
  const bool has_pair_;
  std::atomic<std::uint64_t> field_ = 0;
  std::atomic<std::uint64_t> uplink_ = 0;
  std::atomic<std::uint64_t> pair_ = 0;
  std::uint64_t field_then_ = 0;
  std::uint64_t uplink_then_ = 0;
  std::uint64_t pair_then_ = 0;
};

}  // namespace fxagent
