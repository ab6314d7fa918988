#include "tests/sim/plc.h"

namespace fxsim {
namespace {

constexpr Device kRunMonitor{Kind::special_m, 0};       // M8000: on in RUN
constexpr Device kStopMonitor{Kind::special_m, 1};      // M8001: the opposite
constexpr Device kInitialPulse{Kind::special_m, 2};     // M8002: never visible
constexpr Device kInitialPulseOff{Kind::special_m, 3};  // M8003: the opposite
constexpr Device kForcedRunMode{Kind::special_m, 35};
constexpr Device kForcedRun{Kind::special_m, 36};
constexpr Device kForcedStop{Kind::special_m, 37};
constexpr Device kGlobalSignal{Kind::special_m, 126};  // set and cleared by the computer link's GW
constexpr Device kType{Kind::special_d, 1};            // D8001
constexpr Device kExtendedType{Kind::special_d, 101};  // D8101
constexpr Device kMemoryType{Kind::special_d, 3};      // D8003: 10h, built-in memory
constexpr Device kScanNow{Kind::special_d, 10};        // D8010 to D8012: scan time in 0.1 ms

// iQ-F, Q, L and iQ-R. SM8000 and SM8001 of iQ-F correspond to M8000 and M8001 of FX3.
constexpr Device kAlwaysOn{Kind::sm, 400};
constexpr Device kRunMonitorOfIqF{Kind::sm, 8000};
constexpr Device kStopMonitorOfIqF{Kind::sm, 8001};
constexpr Device kOperatingState{Kind::sd, 203};  // low digit: 0 RUN, 2 STOP, 3 PAUSE

}  // namespace

Plc::Plc(const Model& model, std::unique_ptr<Plant> plant, TimePoint start)
    : memory_(model),
      plant_(std::move(plant)),
      start_(start),
      has_system_(memory_.has(kRunMonitor)),
      has_mc_system_(memory_.has(kOperatingState)),
      type_word_(model.type_word),
      extended_type_word_(model.extended_type_word) {
  if (has_system_) {
    memory_.set(kMemoryType, 0x10);
    memory_.set(kScanNow, 7);
    memory_.set({Kind::special_d, kScanNow.number + 1}, 7);
    memory_.set({Kind::special_d, kScanNow.number + 2}, 41);
  }
  plant_->start(memory_);
  refresh_system();
}

void Plc::advance(TimePoint now) {
  const std::int64_t due = (now - start_) / kScanTime;
  if (due <= scans_done_) return;
  if (running_) plant_->scan(memory_, due - scans_done_);
  scans_done_ = due;
}

void Plc::set_running(bool run) {
  if (has_system_) memory_.set(kForcedStop, run ? 0 : 1);
  enter(run && run_switch_);
}

void Plc::set_run_switch(bool run) {
  run_switch_ = run;
  enter(running_ && run);
}

void Plc::pause() {
  enter(false);
  paused_ = true;
  refresh_system();
}

bool Plc::force_run() {
  if (run_switch_ || running_) return false;
  for (const auto relay : {kForcedRunMode, kForcedRun}) memory_.set(relay, 1);
  memory_.set(kForcedStop, 0);
  enter(true);
  run_forced_ = true;
  return true;
}

bool Plc::force_stop() {
  if (!run_forced_) return false;
  memory_.set(kForcedStop, 1);
  enter(false);
  return true;
}

void Plc::clear(bool latched) {
  memory_.clear(latched);
  refresh_system();
}

void Plc::preset(Device device, std::uint32_t value) {
  memory_.set(device, value);
  if (device == kType) type_word_ = static_cast<std::uint16_t>(value);
  if (device == kExtendedType) extended_type_word_ = static_cast<std::uint16_t>(value);
  refresh_system();
}

void Plc::force(Device device, bool on) {
  memory_.set(device, on ? 1 : 0);
  command_run_state(device, on);
  refresh_system();
}

void Plc::write(Device device, std::uint32_t value) {
  if (width(device.kind) == 1) {
    force(device, (value & 1U) != 0);
    return;
  }
  memory_.set(device, value);
  refresh_system();
}

void Plc::write_byte(Kind kind, std::size_t offset, std::uint8_t value) {
  const unsigned before = memory_.byte(kind, offset);
  const unsigned after = value;
  memory_.set_byte(kind, offset, value);
  if (kind == Kind::special_m) {
    // A byte covers eight relays; only the changed ones are commands.
    const unsigned changed = before ^ after;
    for (unsigned bit = 0; bit < 8; ++bit)
      if (((changed >> bit) & 1U) != 0)
        command_run_state({kind, static_cast<unsigned>(offset * 8 + bit)},
                          ((after >> bit) & 1U) != 0);
  }
  refresh_system();
}

void Plc::command_run_state(Device device, bool on) {
  if (device == kForcedStop) set_running(!on);
  if (device == kForcedRun && on && memory_.get(kForcedRunMode) != 0) set_running(true);
}

void Plc::enter(bool run) {
  running_ = run;
  run_forced_ = false;
  paused_ = false;
  if (!run && has_system_) memory_.set(kGlobalSignal, 0);
  refresh_system();
}

void Plc::refresh_system() {
  if (has_mc_system_) {
    memory_.set(kAlwaysOn, 1);
    memory_.set(kOperatingState, running_ ? 0 : paused_ ? 3 : 2);
    if (memory_.has(kRunMonitorOfIqF)) {
      memory_.set(kRunMonitorOfIqF, running_ ? 1 : 0);
      memory_.set(kStopMonitorOfIqF, running_ ? 0 : 1);
    }
  }
  if (!has_system_) return;
  memory_.set(kRunMonitor, running_ ? 1 : 0);
  memory_.set(kStopMonitor, running_ ? 0 : 1);
  memory_.set(kInitialPulse, 0);
  memory_.set(kInitialPulseOff, 1);
  memory_.set(kType, type_word_);
  memory_.set(kExtendedType, extended_type_word_);
}

}  // namespace fxsim
