#include "protocol/device_walk.h"

namespace fxagent {

void DeviceWalk::device(const Field& field) {
  const ByteView wire = take(field.digits, "its devices");
  if (!good()) return;
  const auto found = device_in(wire);
  if (!found)
    return fault(is_text() ? quoted(wire) + " is not a device of " + std::to_string(field.digits) +
                                 " characters on this model"
                           : "there is no device with this code");
  device_ = *found;
  add_device(device_.name);
  show(field.name, device_.name);
}

void DeviceWalk::bit_device(const Field& field) {
  device(field);
  if (good() && device_.bits != 1) fault(device_.name + " is a word, not a bit");
}

void DeviceWalk::word_device(const Field& field) {
  device(field);
  if (device_.only_bits) fault("contacts of timers and counters can only be accessed bit by bit");
  devices_of_point_ = device_.bits == 1 ? 16 : 1;
}

void DeviceWalk::count_points(const Field& field, std::uint32_t zero) {
  const auto given = number_in(form_, take(field.digits, "its points"));
  points_ = given == 0 ? zero : given.value_or(0);
  if (points_ == 0)
    fault(is_text() ? "the number of points is not two hex digits from 01 up"
                    : "the number of points is 0");
  if (!good()) return;
  show(field.name, std::to_string(points_));
  if (!out_.device) return;
  out_.count = points_ * devices_of_point_;
  if (has_word_points()) *out_.count /= 2;
}

void DeviceWalk::bits(const Field& field) {
  const ByteView data = data_of(points_);
  if (good() && !add_bits(out_, form_, data, points_))
    fault(is_text() ? "the data are not 0 and 1" : "the data are not bits");
  show(field.name, data_text(form_, data));
}

void DeviceWalk::words(const Field& field) {
  const bool is_wide = device_.bits == 32;
  const ByteView data = data_of(points_ * (is_wide && !has_word_points() ? 8 : 4));
  if (is_text() && !is_hex(data)) fault("the data are not hex digits");
  if (good()) add_values(out_, form_, data, is_wide ? 8 : 4, device_.bits);
  show(field.name, data_text(form_, data));
}

void DeviceWalk::items(const Field& field, std::size_t value_digits) {
  for (std::uint32_t i = 0; i < points_; ++i) {
    if (left() < field.digits + value_digits)
      return fault("only " + std::to_string(i) + " of " + std::to_string(points_) +
                   " points are present");
    const ByteView written = take(field.digits, "a device");
    const ByteView wire = take(value_digits, "a value");
    const auto found = device_in(written);
    const auto value = number_in(form_, wire);
    if (!found || found->bits == 32 || (value_digits == 1 && found->bits != 1))
      return fault((is_text() ? quoted(written)
                    : found   ? found->name
                              : "a code") +
                   " is not a device for this command");
    if (!value || (value_digits == 1 && *value > 1))
      return fault(quoted(wire) + " is not a value of " + found->name);
    add_device(found->name);
    out_.values.push_back(is_text() ? as_text(wire)
                                    : hex_text(*value, static_cast<int>(value_digits)));
    show(found->name, out_.values.back());
  }
  out_.count = points_;
}

void DeviceWalk::text(const Field& field) {
  const std::uint32_t length = number(2, "the length of the text");
  // The computer link has no test of nothing.
  if (good() && (left_.size() < length || (length == 0 && is_text())))
    return fault("the text is shorter than its length says");
  const ByteView content = take(is_text() ? length : 2 * length, "the text");
  show(field.name, is_text() ? as_text(content) : to_hex(content));
}

void DeviceWalk::add_device(const std::string& name) {
  out_.device = out_.device ? *out_.device + "," + name : name;
}

std::string DeviceWalk::quoted(ByteView wire) const {
  return is_text() ? "'" + as_text(wire) + "'" : to_hex(wire);
}

ByteView DeviceWalk::data_of(std::size_t digits) {
  if (left() >= digits) return take(digits, "its data");
  fault(std::to_string(left_.size()) + (is_text() ? " data characters" : " bytes of data") +
        " given, " + std::to_string(is_text() ? digits : (digits + 1) / 2) + " expected");
  return {};
}

}  // namespace fxagent
