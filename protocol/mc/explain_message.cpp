#include "protocol/mc/explain_message.h"

#include <algorithm>

#include "protocol/mc/body.h"
#include "protocol/mc/end_code.h"
#include "protocol/mc/message.h"

namespace fxagent::mc {
namespace {

constexpr std::uint32_t kByBits = 1;  // bits of the subcommand
constexpr std::uint32_t kLongCodes = 2;
constexpr std::uint32_t kExtension = 0x80;

/// Parses the digits of a device number in ASCII. Leading zeros may be blanks.
std::optional<std::uint32_t> digits_in(ByteView text, std::uint32_t base) {
  std::uint64_t number = 0;
  for (const std::uint8_t c : text) {
    const int digit = c == ' ' ? 0 : hex_digit(c);
    if (digit < 0 || static_cast<std::uint32_t>(digit) >= base) return std::nullopt;
    number = number * base + static_cast<std::uint32_t>(digit);
  }
  return static_cast<std::uint32_t>(number);
}

bool is_printable(ByteView bytes) {
  return std::all_of(bytes.begin(), bytes.end(),
                     [](std::uint8_t c) { return c >= 0x20 && c < 0x7F; });
}

class RequestExplainer final {
 public:
  RequestExplainer(Model model, Code code, ByteView message, Explanation& out)
      : model_(model), code_(code), left_(message), out_(out) {
    out_.direction = Direction::request;
    out_.operation = "other";
    out_.ok = true;
  }

  void run() {
    const std::uint32_t command = number(2, "the command");
    subcommand_ = number(2, "the subcommand");
    if (!out_.ok) return;
    const auto name = command_name(static_cast<std::uint16_t>(command));
    out_.command = hex_text(command, 4);
    field("command", hex_text(command, 4) + ", " +
                         std::string(name.empty() ? "not known to this program" : name));
    field("subcommand", hex_text(subcommand_, 4) + (is_long() ? ", codes of iQ-R" : ""));
    explain(command);
    if (out_.ok && !left_.empty())
      note_fault(out_, std::to_string(left_.size()) + " characters more than the request has");
  }

 private:
  bool by_bits() const { return (subcommand_ & kByBits) != 0; }
  bool is_long() const { return (subcommand_ & kLongCodes) != 0; }
  void field(std::string name, std::string text) {
    out_.fields.emplace_back(std::move(name), std::move(text));
  }

  void explain(std::uint32_t command) {
    const bool reads = command == 0x0401 || command == 0x0403 || command == 0x0406;
    const bool writes = command == 0x1401 || command == 0x1402 || command == 0x1406;
    if (reads) out_.operation = "read";
    if (writes) out_.operation = "write";
    if ((reads || writes) && (subcommand_ & kExtension) != 0) return as_it_is();
    switch (command) {
      case 0x0401:
      case 0x1401:
        return batch(writes);
      case 0x0403:
        return random(false);
      case 0x1402:
        return by_bits() ? random_bits() : random(true);
      case 0x0406:
      case 0x1406:
        return blocks(writes);
      case 0x0101:
        return;
      case 0x1001:
        field("mode", hex_text(number(2, "the mode"), 4) + (out_.ok ? mode_text() : ""));
        number(1, "the clear mode");
        number(1, "the last byte");
        return;
      case 0x1002:
      case 0x1003:
      case 0x1005:
      case 0x1006:
        field("mode", hex_text(number(2, "the mode"), 4));
        return;
      default:
        return as_it_is();
    }
  }

  std::string mode_text() const { return last_ == 3 ? ", forced" : ", not forced"; }

  void as_it_is() {
    if (!left_.empty()) field("data", shown(left_));
    left_ = {};
  }

  std::string shown(ByteView bytes) const {
    return code_ == Code::ascii && is_printable(bytes) ? std::string(bytes.begin(), bytes.end())
                                                       : to_hex(bytes);
  }

  ByteView take(std::size_t size, std::string_view what) {
    if (left_.size() < size) {
      note_fault(out_, "the frame ends before " + std::string(what));
      left_ = {};
      return {};
    }
    const ByteView taken = left_.first(size);
    left_ = left_.subspan(size);
    return taken;
  }

  std::uint32_t number(std::size_t bytes, std::string_view what) {
    const ByteView wire = take(wire_size(code_, bytes), what);
    if (wire.empty()) return 0;
    const auto value = number_at(code_, wire, 0, bytes);
    if (!value) note_fault(out_, std::string(what) + " is not hex digits: " + to_hex(wire));
    last_ = value.value_or(0);
    return last_;
  }

  /// Returns the name of the next device and stores its space in `space_`.
  std::string device() {
    const ByteView wire = take(device_size(code_, is_long()), "its devices");
    if (wire.empty()) return {};
    std::optional<std::uint32_t> value;
    std::optional<Space> space;
    const std::size_t digits = is_long() ? 4 : 3;
    if (code_ == Code::binary) {
      value = number_at(code_, wire, 0, digits);
      space = space_coded(wire[digits]);
    } else {
      const std::size_t letters = is_long() ? 4 : 2;
      space = space_coded(std::string_view(reinterpret_cast<const char*>(wire.data()), letters));
      if (space) value = digits_in(wire.subspan(letters), base_of(model_, *space));
    }
    if (!space || !value) {
      note_fault(out_, "no device: " + shown(wire));
      return {};
    }
    space_ = *space;
    // An FX5 counts M8000 up among its M. No FX3 uses these frames.
    return device_name(model_, *space, *value);
  }

  bool next_is_bits() const { return kind_of(space_).bits == 1; }

  void name(const std::string& device) {
    out_.device = out_.device ? *out_.device + "," + device : device;
  }

  /// Lists `points` values unchanged: bits, words or double words.
  void values(std::uint32_t points, std::size_t bytes) {
    for (std::uint32_t i = 0; i < points && out_.ok; ++i)
      out_.values.push_back(hex_text(number(bytes, "its data"), static_cast<int>(2 * bytes)));
  }

  /// Lists words of devices. A word of bit devices holds 16 of them, the first one lowest.
  void words(std::uint32_t points) {
    if (!next_is_bits()) return values(points, 2);
    for (std::uint32_t i = 0; i < points && out_.ok; ++i) {
      const std::uint32_t word = number(2, "its data");
      for (std::uint32_t bit = 0; bit < 16 && out_.ok; ++bit)
        out_.values.emplace_back((word >> bit & 1) != 0 ? "1" : "0");
    }
  }

  std::uint32_t devices_in(std::uint32_t words) const {
    return next_is_bits() ? 16 * words : words;
  }

  void bits(std::uint32_t points) {
    const bool ascii = code_ == Code::ascii;
    const ByteView wire = take(ascii ? points : (points + 1) / 2, "its data");
    if (wire.empty()) return;
    const auto image = bits_in(code_, wire, points);
    if (!image) return note_fault(out_, image.error().text);
    for (std::uint32_t i = 0; i < points; ++i)
      out_.values.emplace_back(((*image)[i / 8] >> (i % 8) & 1) != 0 ? "1" : "0");
  }

  void batch(bool writes) {
    name(device());
    if (!out_.ok) return;
    field("device", *out_.device);
    const std::uint32_t points = number(2, "the number of points");
    out_.count = by_bits() ? points : devices_in(points);
    field("points", std::to_string(points) + (by_bits() ? " bits" : " words"));
    if (points == 0) return note_fault(out_, "a request for nothing");
    if (writes && by_bits()) bits(points);
    if (writes && !by_bits()) words(points);
  }

  void random(bool writes) {
    const std::uint32_t words = number(1, "the number of words");
    const std::uint32_t dwords = number(1, "the number of double words");
    field("words", std::to_string(words));
    field("double words", std::to_string(dwords));
    out_.count = words + dwords;
    for (std::uint32_t i = 0; i < words + dwords && out_.ok; ++i) {
      name(device());
      if (writes) values(1, i < words ? 2 : 4);
    }
    if (out_.ok) field("devices", out_.device.value_or(""));
  }

  void random_bits() {
    const std::uint32_t points = number(1, "the number of bits");
    out_.count = points;
    for (std::uint32_t i = 0; i < points && out_.ok; ++i) {
      name(device());
      out_.values.emplace_back(number(is_long() ? 2 : 1, "its data") != 0 ? "1" : "0");
    }
    if (out_.ok) field("devices", out_.device.value_or(""));
  }

  void blocks(bool writes) {
    const std::uint32_t of_words = number(1, "the number of word blocks");
    const std::uint32_t of_bits = number(1, "the number of bit blocks");
    field("word blocks", std::to_string(of_words));
    field("bit blocks", std::to_string(of_bits));
    std::uint32_t total = 0;
    for (std::uint32_t i = 0; i < of_words + of_bits && out_.ok; ++i) {
      const std::string head = device();
      const std::uint32_t points = number(2, "the number of points");
      if (!out_.ok) return;
      if ((i >= of_words) != next_is_bits())
        return note_fault(out_, head + " among the blocks of " + (i < of_words ? "words" : "bits"));
      name(head);
      total += devices_in(points);
      field("block", head + ", " + std::to_string(points) + " words");
      // The data of each block follow its own head.
      if (writes) words(points);
    }
    out_.count = total;
  }

  Model model_;
  Code code_;
  ByteView left_;
  Explanation& out_;
  std::uint32_t subcommand_ = 0;
  std::uint32_t last_ = 0;
  Space space_ = Space::d;
};

}  // namespace

void note_fault(Explanation& out, std::string error) {
  out.ok = false;
  if (!out.error) out.error = std::move(error);
}

void explain_request(Model model, Code code, ByteView message, Explanation& out) {
  RequestExplainer(model, code, message, out).run();
}

void explain_data(Code code, ByteView data, Explanation& out) {
  out.direction = Direction::reply;
  out.ok = true;
  out.operation = data.empty() ? "ack" : "data";
  if (data.empty()) return;
  const std::size_t word = wire_size(code, 2);
  constexpr std::size_t kModelCode = 2;
  if (data.size() == kTypeName + wire_size(code, kModelCode) && is_printable(data.first(kTypeName)))
    out.fields.emplace_back("type name, if it is one",
                            std::string(data.begin(), data.begin() + kTypeName));
  if (data.size() % word == 0 && image_in(code, data, 2)) {
    for (std::size_t at = 0; at < data.size(); at += word)
      out.values.push_back(hex_text(*number_at(code, data, at, 2), 4));
    out.count = static_cast<std::uint32_t>(data.size() / word);
  }
  out.fields.emplace_back("data", code == Code::ascii && is_printable(data)
                                      ? std::string(data.begin(), data.end())
                                      : to_hex(data));
}

void explain_refusal(Model model, std::uint16_t end_code, Explanation& out) {
  out.direction = Direction::reply;
  out.ok = true;
  out.operation = "nak";
  out.values.push_back(hex_text(end_code, 4));
  out.fields.emplace_back("reason", end_code_text(end_code, series_of(model)));
}

}  // namespace fxagent::mc
