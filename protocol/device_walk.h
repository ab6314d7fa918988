// Explains frames whose requests name devices: a device is one field, a bit one digit, a word four.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include "protocol/frame_walk.h"

namespace fxagent {

/// A device named in a frame.
struct FrameDevice {
  std::string name;
  std::uint32_t bits = 16;  ///< 1, 16 or 32
  bool only_bits = false;   ///< never read or written as part of a word
};

/// A FrameWalk with the fields of devices, points and their data.
class DeviceWalk : public FrameWalk {
 public:
  using FrameWalk::FrameWalk;

  void device(const Field& field);
  void bit_device(const Field& field);
  void word_device(const Field& field);
  void points(const Field& field) { count_points(field, 0); }
  void points_to_256(const Field& field) { count_points(field, 256); }  ///< 256 is written 00
  void bits(const Field& field);
  void words(const Field& field);
  void bit_items(const Field& field) { items(field, 1); }  ///< points: a device and its bit
  void word_items(const Field& field) { items(field, 4); }
  void text(const Field& field);  ///< after its length

 protected:
  /// Returns the device that all of `wire` names.
  virtual std::optional<FrameDevice> device_in(ByteView wire) = 0;
  void add_device(const std::string& name);  ///< appends to Explanation::device

  FrameDevice device_;
  std::uint32_t devices_of_point_ = 1;  ///< 16 for a word of a bit device
  std::uint32_t points_ = 0;

 private:
  /// A device of 32 bits is one point in text; in bytes each of its words is a point.
  bool has_word_points() const { return device_.bits == 32 && !is_text(); }
  void count_points(const Field& field, std::uint32_t zero);
  std::string quoted(ByteView wire) const;
  ByteView data_of(std::size_t digits);
  void items(const Field& device, std::size_t value_digits);
};

}  // namespace fxagent
