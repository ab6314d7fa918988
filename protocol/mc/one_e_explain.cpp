// Explains one 1E frame for `fxagent decode` and the line trace. Not used to decode polls.
#include <algorithm>
#include <array>
#include <string>
#include <utility>

#include "protocol/mc/one_e.h"
#include "protocol/mc/one_e_codes.h"
#include "protocol/mc/one_e_frame.h"

namespace fxagent::mc {
namespace {

using one_e::code;

/// Layout of the rest of a frame.
enum class Shape : std::uint8_t { bits, words, bit_items, word_items, nothing, model, text };

struct Known {
  one_e::Command command;
  std::string_view operation;
  std::string_view meaning;
  Shape shape = Shape::nothing;
  bool writes = false;
};
constexpr std::array<Known, 10> kCommands = {{
    {one_e::Command::read_bits, "read", "read of bits", Shape::bits, false},
    {one_e::Command::read_words, "read", "read of words", Shape::words, false},
    {one_e::Command::write_bits, "write", "write of bits", Shape::bits, true},
    {one_e::Command::write_words, "write", "write of words", Shape::words, true},
    {one_e::Command::random_bits, "write", "write of scattered bits", Shape::bit_items, true},
    {one_e::Command::random_words, "write", "write of scattered words", Shape::word_items, true},
    {one_e::Command::run, "other", "remote RUN", Shape::nothing, false},
    {one_e::Command::stop, "other", "remote STOP", Shape::nothing, false},
    {one_e::Command::model, "other", "which PLC is this", Shape::model, false},
    {one_e::Command::loop_back, "other", "loop-back test", Shape::text, false},
}};

const Known* known(std::uint8_t command) {
  const auto* found = std::find_if(kCommands.begin(), kCommands.end(),
                                   [&](const Known& one) { return code(one.command) == command; });
  return found == kCommands.end() ? nullptr : found;
}

Explanation& wrong(Explanation& out, std::string why) {
  out.ok = false;
  out.error = std::move(why);
  return out;
}

/// Reads a frame in its binary form from the front. In ASCII, numbers are high byte first and the
/// device code precedes the number.
class Reader final {
 public:
  Reader(Code data_code, ByteView bytes) : data_code_(data_code), rest_(bytes) {}

  std::size_t left() const { return rest_.size(); }
  ByteView take(std::size_t bytes) {
    const ByteView taken = rest_.first(std::min(bytes, rest_.size()));
    rest_ = rest_.subspan(taken.size());
    return taken;
  }
  std::uint32_t number(std::size_t bytes) {
    const ByteView taken = take(bytes);
    std::uint32_t value = 0;
    for (std::size_t i = 0; i < taken.size(); ++i)
      value = value << 8 | (data_code_ == Code::ascii ? taken[i] : taken[taken.size() - 1 - i]);
    return value;
  }
  /// Reads code and number of a device.
  std::pair<std::uint16_t, std::uint32_t> device() {
    if (data_code_ == Code::ascii) {
      const std::uint32_t device_code = number(2);
      return {static_cast<std::uint16_t>(device_code), number(4)};
    }
    const std::uint32_t device_number = number(4);
    return {static_cast<std::uint16_t>(number(2)), device_number};
  }

 private:
  Code data_code_;
  ByteView rest_;
};

/// A device in a frame.
struct Place {
  std::string name;
  bool is_bit;
  bool is_long;
};

std::optional<Place> place_in(Model model, Reader& in) {
  const auto [device_code, number] = in.device();
  auto space = space_coded_1e(device_code);
  if (!space) return std::nullopt;
  // M8000 up, D8000 up and CN200 up of an FX3 are separate spaces with the same code.
  for (std::uint16_t i = 0; i < kSpaces; ++i) {
    const auto other = static_cast<Space>(i);
    const bool same = kind_of(other).one_e == device_code;
    const auto numbers = numbers_of(model, other);
    if (same && numbers && numbers->first <= number && number <= numbers->last) space = other;
  }
  const DeviceKind& kind = kind_of(*space);
  return Place{device_name(model, *space, number), kind.bits == 1, kind.bits == 32};
}

void add_bits(Explanation& out, ByteView image, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i)
    out.values.emplace_back((image[i / 8] >> (i % 8) & 1) != 0 ? "1" : "0");
}

/// Adds words as they are, as the points of a bit device, or in pairs.
void add_words(Explanation& out, ByteView image, const Place* place) {
  if (place != nullptr && place->is_bit) return add_bits(out, image, image.size() * 8);
  const std::size_t step = place != nullptr && place->is_long ? 4 : 2;
  for (std::size_t at = 0; at + step <= image.size(); at += step) {
    std::uint32_t value = 0;
    for (std::size_t i = step; i > 0; --i) value = value << 8 | image[at + i - 1];
    out.values.push_back(hex_text(value, static_cast<int>(2 * step)));
  }
}

/// Explains the part after the head of a request.
class RequestBody final {
 public:
  RequestBody(Model model, Code data_code, const Known& what, Reader& in, Explanation& out)
      : model_(model), data_code_(data_code), what_(what), in_(in), out_(out) {}

  void explain() {
    switch (what_.shape) {
      case Shape::bits:
      case Shape::words:
        run();
        break;
      case Shape::bit_items:
      case Shape::word_items:
        items();
        break;
      case Shape::text:
        text();
        break;
      case Shape::nothing:
      case Shape::model:
        break;
    }
    if (out_.ok && in_.left() != 0)
      wrong(out_, std::to_string(in_.left()) + " bytes are left over");
  }

 private:
  /// A read of bits writes 256 as 00.
  std::uint32_t points() {
    const std::uint32_t given = in_.number(1);
    if (in_.number(1) != 0) wrong(out_, "the byte behind the number of points is not 00");
    const std::uint32_t meant =
        given == 0 && what_.command == one_e::Command::read_bits ? 256 : given;
    if (meant == 0) wrong(out_, "the number of points is 0");
    out_.fields.emplace_back("points", std::to_string(meant));
    return meant;
  }

  void run() {
    if (in_.left() < one_e::kDevice + 2) {
      wrong(out_, "the request is cut short");
      return;
    }
    const auto place = place_in(model_, in_);
    if (!place) {
      wrong(out_, "there is no device with this code");
      return;
    }
    out_.device = place->name;
    out_.fields.emplace_back("device", place->name);
    const std::uint32_t count = points();
    if (!out_.ok) return;
    const bool by_bits = what_.shape == Shape::bits;
    if (by_bits && !place->is_bit) {
      wrong(out_, place->name + " is a word, not a bit");
      return;
    }
    out_.count = !by_bits && place->is_bit ? count * 16 : place->is_long ? count / 2 : count;
    if (what_.writes) data(*place, count);
  }

  void data(const Place& place, std::uint32_t count) {
    const bool by_bits = what_.shape == Shape::bits;
    const std::size_t due = by_bits ? one_e::bytes_of_bits(count) : count * 2U;
    if (in_.left() < due) {
      wrong(out_, std::to_string(in_.left()) + " bytes of data given, " + std::to_string(due) +
                      " expected");
      return;
    }
    const ByteView given = in_.take(due);
    out_.fields.emplace_back("data", to_hex(given));
    if (!by_bits) return add_words(out_, one_e::image_of_words(data_code_, given), &place);
    const auto image = one_e::image_of_bits(given, count);
    if (image)
      add_bits(out_, *image, count);
    else
      wrong(out_, "the data are not bits");
  }

  void items() {
    const bool by_bits = what_.shape == Shape::bit_items;
    const std::uint32_t count = points();
    for (std::uint32_t i = 0; out_.ok && i < count; ++i) {
      const std::size_t value_bytes = by_bits ? 1 : 2;
      if (in_.left() < one_e::kDevice + value_bytes) {
        wrong(out_,
              "only " + std::to_string(i) + " of " + std::to_string(count) + " points are there");
        return;
      }
      const auto place = place_in(model_, in_);
      const std::uint32_t value = in_.number(value_bytes);
      if (!place || place->is_long || (by_bits && !place->is_bit)) {
        wrong(out_,
              (place ? place->name : std::string("a code")) + " is no device for this command");
        return;
      }
      if (by_bits && value > 1) {
        wrong(out_, hex_text(value, 2) + " is no value of " + place->name);
        return;
      }
      out_.device = i == 0 ? place->name : *out_.device + "," + place->name;
      out_.values.push_back(by_bits ? std::to_string(value) : hex_text(value, 4));
      out_.fields.emplace_back(place->name, out_.values.back());
    }
    out_.count = count;
  }

  void text() {
    const std::uint32_t length = in_.number(1);
    if (in_.left() < length) {
      wrong(out_, "the text is shorter than its length says");
      return;
    }
    out_.fields.emplace_back("text", to_hex(in_.take(length)));
  }

  Model model_;
  Code data_code_;
  const Known& what_;
  Reader& in_;
  Explanation& out_;
};

void explain_answer(Code data_code, const Known& what, Reader& in, Explanation& out) {
  if (in.left() == 0) {
    wrong(out, "the answer is cut short");
    return;
  }
  const auto end_code = static_cast<int>(in.number(1));
  if (end_code != 0) {
    out.operation = "nak";
    const auto reason = in.take(in.left());
    if (reason.size() != 0 && reason.size() != 2) {
      wrong(out, "behind an end code come an abnormal code and 00, or nothing");
      return;
    }
    const auto abnormal = reason.empty() ? std::nullopt : std::optional<int>(reason[0]);
    out.fields.emplace_back("reason", one_e::refusal(end_code, abnormal));
    return;
  }
  out.fields.emplace_back("end code", "00, done");
  const bool answers_with_data = what.operation == "read" || what.shape == Shape::model;
  out.operation = what.shape == Shape::text ? "other" : answers_with_data ? "data" : "ack";
  const ByteView data = in.take(in.left());
  if (!data.empty()) out.fields.emplace_back("data", to_hex(data));
  if (what.shape == Shape::text) return;
  if (data.empty() == answers_with_data) {
    wrong(out, answers_with_data ? "there are no data" : "nothing follows the end code of a write");
  } else if (what.shape == Shape::model) {
    const std::string_view name = one_e::model_coded(data[0]);
    out.values.push_back(hex_text(data[0], 2));
    out.fields.emplace_back("model", name.empty() ? "one that is not known here" : name);
  } else if (what.shape == Shape::words && answers_with_data) {
    if (data.size() % 2 != 0)
      wrong(out, "an odd count of bytes cannot be words");
    else
      add_words(out, one_e::image_of_words(data_code, data), nullptr);
  } else if (answers_with_data) {
    const auto image = one_e::image_of_bits(data, data.size() * 2);
    if (image)
      add_bits(out, *image, data.size() * 2);
    else
      wrong(out, "the data are not bits");
  }
  if (!out.values.empty()) out.count = static_cast<std::uint32_t>(out.values.size());
}

}  // namespace

Explanation one_e::explain_frame(Model model, ByteView frame, std::optional<Direction> direction) {
  Explanation out;
  out.ok = true;
  out.direction = direction.value_or(Direction::request);
  out.operation = "other";
  if (frame.empty()) return wrong(out, "no bytes");
  // No command or answer begins with the code of a digit.
  const bool in_ascii = hex_digit(frame[0]) >= 0;
  const Code data_code = in_ascii ? Code::ascii : Code::binary;
  const auto binary =
      in_ascii ? from_ascii(frame) : std::optional(Bytes(frame.begin(), frame.end()));
  out.fields.emplace_back("data code", in_ascii ? "ASCII" : "binary");
  if (!binary || (in_ascii && frame.size() % 2 != 0))
    return wrong(out, "a frame in ASCII has pairs of hex digits only");
  Reader in(data_code, *binary);
  const auto first = static_cast<std::uint8_t>(in.number(1));
  const bool is_answer = (first & kAnswer) != 0;
  const Known* what = known(static_cast<std::uint8_t>(first & ~kAnswer));
  if (what == nullptr)
    return wrong(out, hex_text(first, 2) + " is neither a command of a 1E frame nor its answer");
  out.direction = is_answer ? Direction::reply : Direction::request;
  out.operation = what->operation;
  out.command = hex_text(code(what->command), 2);
  out.fields.emplace_back("command", *out.command + ", " + std::string(what->meaning));
  if (direction && *direction != out.direction)
    return wrong(out, hex_text(first, 2) + " begins " + (is_answer ? "an answer" : "a request"));
  if (!is_answer && what->operation == "other") out.fields.emplace_back("meaning", what->meaning);
  if (is_answer) {
    explain_answer(data_code, *what, in, out);
    return out;
  }
  if (binary->size() < kRequestHead) return wrong(out, "the request is cut short");
  out.fields.emplace_back("PC number", hex_text(in.number(1), 2));
  const std::uint32_t timer = in.number(2);
  out.fields.emplace_back("monitoring timer",
                          timer == 0 ? "none" : std::to_string(timer * 250) + " ms");
  RequestBody(model, data_code, *what, in, out).explain();
  return out;
}

}  // namespace fxagent::mc
