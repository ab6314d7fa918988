// Counts the samples that were lost: dropped to make room, or refused for good. Uplink thread.
#pragma once

#include <cstdint>
#include <map>
#include <string>

namespace fxagent {

class DroppedSamples final {
 public:
  /// The device may exist only in the store.
  void add(const std::string& device, std::uint64_t count) {
    by_device_[device] += count;
    total_ += count;
  }
  std::uint64_t total() const { return total_; }
  std::uint64_t of(const std::string& device) const {
    const auto found = by_device_.find(device);
    return found == by_device_.end() ? 0 : found->second;
  }

 private:
  /// By device name: the store may have rows of devices that the config no longer has.
  std::map<std::string, std::uint64_t> by_device_;
  std::uint64_t total_ = 0;
};

}  // namespace fxagent
