// Whether field and uplink still go on, as the watchdog of the service manager wants to know: each
// of them is asked for a sign of life, and gives one only by doing what it always does.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>

namespace fxagent {

class SignsOfLife final {
 public:
  /// Their own threads, each time round.
  void field_went_on() noexcept { ++field_; }
  void uplink_went_on() noexcept { ++uplink_; }

  /// Who has given no sign since this last said nobody: "field", "uplink", "field and uplink", or
  /// empty. One thread.
  std::string stands_still();

 private:
  std::atomic<std::uint64_t> field_ = 0;
  std::atomic<std::uint64_t> uplink_ = 0;
  std::uint64_t field_then_ = 0;
  std::uint64_t uplink_then_ = 0;
};

}  // namespace fxagent
