// The dynamic part of a simulated PLC: the process it controls and the ladder program that runs in
// it. Time is a number of scans, so a plant behaves the same however often it is polled.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <string_view>

#include "tests/sim/memory.h"

namespace fxsim {

inline constexpr std::chrono::milliseconds kScanTime{20};

class Plant {
 public:
  virtual ~Plant() = default;
  /// Sets the initial values of the process.
  virtual void start(DeviceMemory& memory) = 0;
  /// Runs the next `scans` scans of the ladder.
  virtual void scan(DeviceMemory& memory, std::int64_t scans) = 0;
};

/// "none" (static memory), "demo" or "counter"; null for any other name.
std::unique_ptr<Plant> make_plant(std::string_view name);
inline constexpr std::string_view kPlantNames = "none demo counter";

}  // namespace fxsim
