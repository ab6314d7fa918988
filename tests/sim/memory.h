// Device memory of one PLC, byte for byte as the ports show it: bits packed with the lowest number
// in the lowest bit, words and 32-bit counters with the low byte first.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "tests/sim/model.h"

namespace fxsim {

class DeviceMemory final {
 public:
  /// All devices of `model`, all 0. `model` must outlive this.
  explicit DeviceMemory(const Model& model);

  bool has(Device device) const;
  /// The raw value, without sign. Precondition: has(device).
  std::uint32_t get(Device device) const;
  /// Sets the low width() bits. Precondition: has(device).
  void set(Device device, std::uint32_t value);

  /// Does any device of `kind` live in byte `offset` of its row?
  bool has_byte(Kind kind, std::size_t offset) const;
  /// Precondition of both: has_byte(kind, offset). Bits that belong to no device stay 0.
  std::uint8_t byte(Kind kind, std::size_t offset) const;
  void set_byte(Kind kind, std::size_t offset, std::uint8_t value);

  const Model& model() const { return model_; }

 private:
  std::vector<std::uint8_t>& row(Kind kind) { return rows_[static_cast<std::size_t>(kind)]; }
  const std::vector<std::uint8_t>& row(Kind kind) const {
    return rows_[static_cast<std::size_t>(kind)];
  }

  const Model& model_;
  std::array<std::vector<std::uint8_t>, kKinds> rows_;
};

}  // namespace fxsim
