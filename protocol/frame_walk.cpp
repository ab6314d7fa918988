#include "protocol/frame_walk.h"

#include <algorithm>
#include <bit>
#include <utility>

#include "protocol/letter_case.h"

namespace fxagent {

bool is_printable(ByteView wire) {
  return std::ranges::all_of(wire, [](std::uint8_t c) { return c >= 0x20 && c < 0x7F; });
}

std::string data_text(NumberForm form, ByteView data) {
  return form == NumberForm::digits && is_printable(data) ? as_text(data) : to_hex(data);
}

Explanation begin_explanation(std::optional<Direction> direction) {
  Explanation out;
  out.ok = true;
  out.direction = direction.value_or(Direction::request);
  out.operation = "other";
  return out;
}

Explanation& wrong(Explanation& out, std::string error) {
  out.ok = false;
  if (!out.error) out.error = std::move(error);
  return out;
}

Explanation& judge_sum(Explanation& out, std::string given, std::uint8_t computed) {
  out.checksum_given = std::move(given);
  out.checksum_computed = hex_text(computed, 2);
  if (upper(*out.checksum_given) == *out.checksum_computed) return out;
  return wrong(out,
               "sum " + *out.checksum_given + " given, " + *out.checksum_computed + " computed");
}

void add_values(Explanation& out, NumberForm form, ByteView data, std::size_t digits,
                std::uint32_t device_bits) {
  const std::size_t size = form == NumberForm::digits ? digits : digits / 2;
  for (std::size_t at = 0; at + size <= data.size(); at += size) {
    std::uint32_t number = number_in(form, data.subspan(at, size)).value_or(0);
    if (form == NumberForm::high_first && digits == 8) number = std::rotl(number, 16);
    if (device_bits != 1) out.values.push_back(hex_text(number, static_cast<int>(digits)));
    for (std::size_t bit = 0; device_bits == 1 && bit < 4 * digits; ++bit)
      out.values.emplace_back((number >> bit & 1) != 0 ? "1" : "0");
  }
}

bool add_bits(Explanation& out, NumberForm form, ByteView data, std::size_t count) {
  std::vector<std::string> bits;
  for (std::size_t i = 0; i < count; ++i) {
    const int bit = form == NumberForm::digits ? data[i] - '0'
                    : i % 2 == 0               ? data[i / 2] >> 4
                                               : data[i / 2] & 0x0F;
    if (bit != 0 && bit != 1) return false;
    bits.emplace_back(bit == 1 ? "1" : "0");
  }
  out.values.insert(out.values.end(), bits.begin(), bits.end());
  return true;
}

void FrameWalk::walk(const Fields& fields) {
  for (const Field& field : fields)
    if (field.read != nullptr && good()) field.read(*this, field);
}

void FrameWalk::hex(const Field& field) {
  show(field.name, hex_text(number(field), static_cast<int>(field.digits)));
}

void FrameWalk::rest(const Field& field) {
  if (!left_.empty()) show(field.name, data_text(form_, left_));
  left_ = {};
}

std::string FrameWalk::cut_before(std::string_view /*what*/) const {
  return "the request is truncated";
}

void FrameWalk::show(std::string_view name, std::string_view text) {
  if (good() && !name.empty()) out_.fields.emplace_back(name, text);
}

ByteView FrameWalk::take(std::size_t digits, std::string_view what) {
  const std::size_t size = is_text() ? digits : (digits + 1) / 2;
  if (left_.size() < size) {
    fault(cut_before(what));
    return left_ = {};
  }
  const ByteView taken = left_.first(size);
  left_ = left_.subspan(size);
  return taken;
}

std::uint32_t FrameWalk::number(std::size_t digits, std::string_view what) {
  const ByteView wire = take(digits, what);
  const auto value = number_in(form_, wire);
  if (!value) fault(std::string(what) + " is not hex digits: " + to_hex(wire));
  return value.value_or(0);
}

std::uint32_t FrameWalk::number(const Field& field) {
  return number(field.digits, "the " + std::string(field.name));
}

}  // namespace fxagent
