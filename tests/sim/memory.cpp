#include "tests/sim/memory.h"

#include <algorithm>

namespace fxsim {

bool DeviceMemory::has(Device device) const {
  return std::ranges::any_of(model_->of(device.kind), [&](const Range& range) {
    return device.number >= range.first && device.number <= range.last;
  });
}

std::uint32_t DeviceMemory::get(Device device) const {
  if (ramp_ && shows_ramp(device.kind)) return static_cast<std::uint16_t>(*ramp_ + device.number);
  const auto bits = width(device.kind);
  if (bits == 1)
    return (std::uint32_t{stored(device.kind, device.number / 8)} >> (device.number % 8)) & 1U;
  const std::size_t size = bits / 8;
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < size; ++i)
    value |= static_cast<std::uint32_t>(stored(device.kind, device.number * size + i)) << (8 * i);
  return value;
}

void DeviceMemory::set(Device device, std::uint32_t value) {
  const auto bits = width(device.kind);
  if (bits == 1) {
    const auto before = stored(device.kind, device.number / 8);
    const auto mask = static_cast<std::uint8_t>(1U << (device.number % 8));
    store(device.kind, device.number / 8,
          static_cast<std::uint8_t>((value & 1U) != 0 ? before | mask : before & ~mask));
    return;
  }
  const std::size_t size = bits / 8;
  for (std::size_t i = 0; i < size; ++i)
    store(device.kind, device.number * size + i, static_cast<std::uint8_t>(value >> (8 * i)));
}

bool DeviceMemory::has_byte(Kind kind, std::size_t offset) const {
  const auto bits = width(kind);
  return std::ranges::any_of(model_->of(kind), [&](const Range& range) {
    const auto first = static_cast<std::size_t>(range.first) * bits / 8;
    const auto last = (static_cast<std::size_t>(range.last) * bits + bits - 1) / 8;
    return offset >= first && offset <= last;
  });
}

std::uint8_t DeviceMemory::byte(Kind kind, std::size_t offset) const {
  return stored(kind, offset);
}

void DeviceMemory::set_byte(Kind kind, std::size_t offset, std::uint8_t value) {
  if (width(kind) != 1) {
    store(kind, offset, value);
    return;
  }
  for (unsigned bit = 0; bit < 8; ++bit) {
    const Device device{kind, static_cast<unsigned>(offset * 8 + bit)};
    if (has(device)) set(device, std::uint32_t{value} >> bit);
  }
}

void DeviceMemory::clear(bool latched) {
  for (std::size_t kind = 0; kind < kKinds; ++kind)
    if (latched || kind != static_cast<std::size_t>(Kind::l)) rows_[kind].clear();
}

bool DeviceMemory::shows_ramp(Kind kind) const {
  if (kind == Kind::d) return model_->family != Family::fx;
  return kind == Kind::holding_register || kind == Kind::input_register;
}

std::uint8_t DeviceMemory::stored(Kind kind, std::size_t offset) const {
  const auto& row = rows_[static_cast<std::size_t>(kind)];
  const auto page = offset / kPageSize;
  return page < row.size() && row[page] ? (*row[page])[offset % kPageSize] : std::uint8_t{0};
}

void DeviceMemory::store(Kind kind, std::size_t offset, std::uint8_t value) {
  auto& row = rows_[static_cast<std::size_t>(kind)];
  const auto page = offset / kPageSize;
  if (page >= row.size() || !row[page]) {
    if (value == 0) return;
    if (page >= row.size()) row.resize(page + 1);
    row[page] = std::make_unique<Page>();
  }
  (*row[page])[offset % kPageSize] = value;
}

}  // namespace fxsim
