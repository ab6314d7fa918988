#include "tests/sim/plant.h"

#include <algorithm>
#include <cmath>

namespace fxsim {
namespace {

constexpr double kScanSeconds = std::chrono::duration<double>(kScanTime).count();

class StillPlant final : public Plant {
 public:
  void start(DeviceMemory&) override {}
  void scan(DeviceMemory&, std::int64_t) override {}
};

/// D n (register n of a Modbus device) = (scans since the start + n) modulo 65536.
class CounterPlant final : public Plant {
 public:
  void start(DeviceMemory& memory) override { show(memory); }
  void scan(DeviceMemory& memory, std::int64_t scans) override {
    if (scans <= 0) return;
    scans_ += scans;
    show(memory);
  }

 private:
  void show(DeviceMemory& memory) const {
    memory.show_ramp(static_cast<std::uint16_t>(scans_));
    if (memory.model().family != Family::fx) return;
    for (const auto& range : memory.model().of(Kind::d))
      for (auto n = range.first; n <= range.last; ++n)
        memory.set({Kind::d, n}, static_cast<std::uint32_t>(scans_ + n));
  }

  std::int64_t scans_ = 0;
};

/// An oven with a conveyor; for its devices see docs/simulator.md.
class DemoPlant final : public Plant {
 public:
  void start(DeviceMemory& memory) override {
    memory.set(kRunning, 1);
    memory.set(kSetpoint, 500);
    memory.set(kSpeed, 250);
    memory.set(kAlarmLimit, 800);
    memory.set(kZone1, 200);
    memory.set(kZone2, 200);
    memory.set(kMotor, 200);
    // A model without C200 counts its parts in C235, the first 32-bit counter of the small models;
    // an FX5 uses LC0.
    if (!memory.has(parts_)) parts_ = {Kind::c_value32, 35};
    if (!memory.has(parts_)) parts_ = {Kind::lc_value, 0};
  }

  void scan(DeviceMemory& memory, std::int64_t scans) override {
    for (std::int64_t i = 0; i < scans; ++i) scan_once(memory);
  }

 private:
  static constexpr Device kRunning{Kind::m, 0};
  static constexpr Device kUpToSpeed{Kind::m, 1};
  static constexpr Device kTooHot{Kind::m, 50};
  static constexpr Device kBadSetpoint{Kind::m, 51};
  static constexpr Device kStopped{Kind::m, 52};
  static constexpr Device kStart{Kind::m, 100};
  static constexpr Device kStop{Kind::m, 101};
  static constexpr Device kZone1{Kind::d, 100};
  static constexpr Device kZone2{Kind::d, 101};
  static constexpr Device kMotor{Kind::d, 102};
  static constexpr Device kPressure{Kind::d, 103};
  static constexpr Device kPosition{Kind::d, 110};
  static constexpr Device kBatches{Kind::d, 120};
  static constexpr Device kSetpoint{Kind::d, 200};
  static constexpr Device kSpeed{Kind::d, 201};
  static constexpr Device kAlarmLimit{Kind::d, 210};
  static constexpr Device kBatchCounter{Kind::c_value, 0};
  static constexpr Device kBatchFull{Kind::c_contact, 0};
  static constexpr std::uint32_t kBatchSize = 10;
  static constexpr std::uint32_t kMaxSetpoint = 1000;
  static constexpr double kPartDistanceMm = 500;
  static constexpr double kPartLengthMm = 100;

  void scan_once(DeviceMemory& memory) {
    ++scans_;
    const double seconds = static_cast<double>(scans_) * kScanSeconds;
    refresh_clock(memory);
    refresh_inputs(memory);
    run_conveyor(memory);
    count_parts(memory);
    heat(memory, seconds);
    drive_outputs(memory);
  }

  /// M8011 to M8014: clocks of 10 ms, 100 ms, 1 s and 1 min. The first is as fast as a scan allows.
  void refresh_clock(DeviceMemory& memory) const {
    const auto ms = scans_ * kScanTime.count();
    memory.set({Kind::special_m, 11}, static_cast<std::uint32_t>(scans_ % 2));
    memory.set({Kind::special_m, 12}, ms % 100 < 50 ? 1 : 0);
    memory.set({Kind::special_m, 13}, ms % 1000 < 500 ? 1 : 0);
    memory.set({Kind::special_m, 14}, ms % 60000 < 30000 ? 1 : 0);
  }

  /// The process drives every X, so a forced input lasts until the next scan.
  void refresh_inputs(DeviceMemory& memory) const {
    for (const auto& range : memory.model().of(Kind::x))
      for (auto n = range.first; n <= range.last; ++n) memory.set({Kind::x, n}, 0);
    const bool entry = std::fmod(position_mm_, kPartDistanceMm) < kPartLengthMm;
    const bool exit =
        std::fmod(position_mm_ + kPartDistanceMm / 2, kPartDistanceMm) < kPartLengthMm;
    memory.set({Kind::x, 0}, entry ? 1 : 0);
    memory.set({Kind::x, 1}, exit ? 1 : 0);
    memory.set({Kind::x, 2}, 1);  // guard closed
  }

  void run_conveyor(DeviceMemory& memory) {
    if (memory.get(kStart) != 0) memory.set(kRunning, 1);
    if (memory.get(kStop) != 0) memory.set(kRunning, 0);  // stop wins
    memory.set(kStart, 0);
    memory.set(kStop, 0);
    const bool running = memory.get(kRunning) != 0;
    if (running) position_mm_ += memory.get(kSpeed) * kScanSeconds;
    memory.set(kPosition, static_cast<std::uint32_t>(std::fmod(position_mm_, 10000.0)));

    // T0: on-delay of 5.0 s in steps of 0.1 s.
    running_scans_ = running ? std::min<std::int64_t>(running_scans_ + 1, 250) : 0;
    memory.set({Kind::t_coil, 0}, running ? 1 : 0);
    memory.set({Kind::t_value, 0}, static_cast<std::uint32_t>(running_scans_ / 5));
    memory.set({Kind::t_contact, 0}, running_scans_ == 250 ? 1 : 0);
    memory.set(kUpToSpeed, running_scans_ == 250 ? 1 : 0);
  }

  void count_parts(DeviceMemory& memory) {
    const bool seen = memory.get({Kind::x, 1}) != 0;
    if (seen && !exit_was_blocked_) {
      memory.set(parts_, memory.get(parts_) + 1);
      if (memory.get(kBatchCounter) >= kBatchSize) {
        memory.set(kBatchCounter, 0);
        memory.set(kBatches, memory.get(kBatches) + 1);
      }
      memory.set(kBatchCounter, memory.get(kBatchCounter) + 1);
      memory.set(kBatchFull, memory.get(kBatchCounter) >= kBatchSize ? 1 : 0);
    }
    exit_was_blocked_ = seen;
  }

  /// Temperatures in 0.1 degrees: zone 1 follows the setpoint within seconds, zone 2 lags behind
  /// zone 1.
  void heat(DeviceMemory& memory, double seconds) {
    const double setpoint = std::min(memory.get(kSetpoint), kMaxSetpoint);
    zone1_ += (setpoint - zone1_) * kScanSeconds / 3.0;
    zone2_ += (setpoint * 0.8 - zone2_) * kScanSeconds / 10.0;
    motor_ += ((memory.get(kRunning) != 0 ? 650.0 : 200.0) - motor_) * kScanSeconds / 60.0;
    memory.set(kZone1, word(zone1_ + 2.0 * std::sin(seconds)));
    memory.set(kZone2, word(zone2_ + 3.0 * std::sin(seconds / 3.0)));
    memory.set(kMotor, word(motor_));
    memory.set(kPressure, word(1000.0 + 50.0 * std::sin(seconds / 7.0)));
    memory.set(kTooHot, memory.get(kZone1) > memory.get(kAlarmLimit) ? 1 : 0);
    memory.set(kBadSetpoint, memory.get(kSetpoint) > kMaxSetpoint ? 1 : 0);
    memory.set(kStopped, memory.get(kRunning) != 0 ? 0 : 1);
  }

  /// The ladder drives Y0 to Y2: a forced value is overwritten here. The other outputs are free.
  void drive_outputs(DeviceMemory& memory) const {
    memory.set({Kind::y, 0}, memory.get(kRunning));
    memory.set({Kind::y, 1}, memory.get(kZone1) < memory.get(kSetpoint) ? 1 : 0);
    const bool alarm = (memory.get(kTooHot) | memory.get(kBadSetpoint)) != 0;
    memory.set({Kind::y, 2}, alarm ? memory.get({Kind::special_m, 13}) : 0);
  }

  static std::uint32_t word(double value) {
    return static_cast<std::uint32_t>(std::lround(std::clamp(value, 0.0, 32767.0)));
  }

  Device parts_{Kind::c_value32, 0};
  std::int64_t scans_ = 0;
  std::int64_t running_scans_ = 0;
  double position_mm_ = 0;
  double zone1_ = 200;
  double zone2_ = 200;
  double motor_ = 200;
  bool exit_was_blocked_ = false;
};

}  // namespace

std::unique_ptr<Plant> make_plant(std::string_view name) {
  if (name == "none") return std::make_unique<StillPlant>();
  if (name == "demo") return std::make_unique<DemoPlant>();
  if (name == "counter") return std::make_unique<CounterPlant>();
  return nullptr;
}

}  // namespace fxsim
