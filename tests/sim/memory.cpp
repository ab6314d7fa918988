#include "tests/sim/memory.h"

#include <algorithm>

namespace fxsim {

DeviceMemory::DeviceMemory(const Model& model) : model_(model) {
  for (std::size_t i = 0; i < kKinds; ++i) {
    const auto kind = static_cast<Kind>(i);
    unsigned count = 0;
    for (const auto& range : model.of(kind)) count = std::max(count, range.last + 1);
    rows_[i].assign((static_cast<std::size_t>(count) * width(kind) + 7) / 8, 0);
  }
}

bool DeviceMemory::has(Device device) const {
  return std::ranges::any_of(model_.of(device.kind), [&](const Range& range) {
    return device.number >= range.first && device.number <= range.last;
  });
}

std::uint32_t DeviceMemory::get(Device device) const {
  const auto& bytes = row(device.kind);
  const auto bits = width(device.kind);
  if (bits == 1) return (std::uint32_t{bytes[device.number / 8]} >> (device.number % 8)) & 1U;
  const std::size_t size = bits / 8;
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < size; ++i)
    value |= static_cast<std::uint32_t>(bytes[device.number * size + i]) << (8 * i);
  return value;
}

void DeviceMemory::set(Device device, std::uint32_t value) {
  auto& bytes = row(device.kind);
  const auto bits = width(device.kind);
  if (bits == 1) {
    auto& byte = bytes[device.number / 8];
    const auto mask = static_cast<std::uint8_t>(1U << (device.number % 8));
    byte = static_cast<std::uint8_t>((value & 1U) != 0 ? byte | mask : byte & ~mask);
    return;
  }
  const std::size_t size = bits / 8;
  for (std::size_t i = 0; i < size; ++i)
    bytes[device.number * size + i] = static_cast<std::uint8_t>(value >> (8 * i));
}

bool DeviceMemory::has_byte(Kind kind, std::size_t offset) const {
  const auto bits = width(kind);
  return std::ranges::any_of(model_.of(kind), [&](const Range& range) {
    const auto first = static_cast<std::size_t>(range.first) * bits / 8;
    const auto last = (static_cast<std::size_t>(range.last) * bits + bits - 1) / 8;
    return offset >= first && offset <= last;
  });
}

std::uint8_t DeviceMemory::byte(Kind kind, std::size_t offset) const { return row(kind)[offset]; }

void DeviceMemory::set_byte(Kind kind, std::size_t offset, std::uint8_t value) {
  if (width(kind) != 1) {
    row(kind)[offset] = value;
    return;
  }
  for (unsigned bit = 0; bit < 8; ++bit) {
    const Device device{kind, static_cast<unsigned>(offset * 8 + bit)};
    if (has(device)) set(device, std::uint32_t{value} >> bit);
  }
}

}  // namespace fxsim
