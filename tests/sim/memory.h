// Device memory of one PLC, byte for byte as the ports present it: bits are packed with the lowest
// number in the lowest bit, words and 32-bit counters are stored low byte first.
// Devices that were never set take no memory, so one process can hold thousands of PLCs with all
// their addresses.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "tests/sim/model.h"

namespace fxsim {

class DeviceMemory final {
 public:
  /// Creates all devices of `model` with value 0. `model` must outlive this.
  explicit DeviceMemory(const Model& model) : model_(&model) {}

  bool has(Device device) const;
  /// Returns the raw value, unsigned. Precondition: has(device).
  std::uint32_t get(Device device) const;
  /// Sets the low width() bits. Precondition: has(device).
  void set(Device device, std::uint32_t value);

  /// True if a device of `kind` occupies byte `offset` of its row.
  bool has_byte(Kind kind, std::size_t offset) const;
  /// Precondition of both: has_byte(kind, offset). Bits without a device stay 0.
  std::uint8_t byte(Kind kind, std::size_t offset) const;
  void set_byte(Kind kind, std::size_t offset, std::uint8_t value);

  /// Sets all devices to 0; L keeps its values unless `latched`.
  void clear(bool latched);

  /// After this call get() returns (`base` + n) modulo 65536 for Modbus register n (holding and
  /// input) and for D n of iQ-F, Q, L and iQ-R. Values that were set are ignored.
  void show_ramp(std::uint16_t base) { ramp_ = base; }

  const Model& model() const { return *model_; }

 private:
  static constexpr std::size_t kPageSize = 1024;
  using Page = std::array<std::uint8_t, kPageSize>;
  using Row = std::vector<std::unique_ptr<Page>>;  // null or missing: all 0

  bool shows_ramp(Kind kind) const;
  std::uint8_t stored(Kind kind, std::size_t offset) const;
  void store(Kind kind, std::size_t offset, std::uint8_t value);

  const Model* model_;
  std::array<Row, kKinds> rows_;
  std::optional<std::uint16_t> ramp_;
};

}  // namespace fxsim
