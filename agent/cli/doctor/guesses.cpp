#include "agent/cli/doctor/guesses.h"

#include <array>
#include <variant>

#include "agent/config/keys.h"

namespace fxagent {
namespace {

constexpr std::array kLikelySpeeds{9600, 19200, 38400, 115200, 57600, 4800, 2400, 1200};
constexpr std::int64_t kLastModbusUnit = 247;

template <class Item>
void add_once(std::vector<Item>& list, const Item& item) {
  if (!contains(list, item)) list.push_back(item);
}

/// Returns the shapes of a character, likeliest first. Their speed is that of `usual`.
std::vector<LineDefaults> shapes_of(const ProtocolInfo& protocol) {
  const LineDefaults& usual = protocol.line;
  std::vector<LineDefaults> shapes{usual};
  if (protocol.one_line) return shapes;
  const int least = protocol.least_data_bits == 0 ? usual.data_bits : protocol.least_data_bits;
  for (const int bits : {usual.data_bits, usual.data_bits == 7 ? 8 : 7}) {
    if (bits < least) continue;
    for (const Parity parity : {Parity::even, Parity::none, Parity::odd})
      add_once(shapes, LineDefaults{usual.baud, bits, parity, 1});
    add_once(shapes, LineDefaults{usual.baud, bits, Parity::none, 2});
  }
  return shapes;
}

}  // namespace

std::vector<LineDefaults> line_guesses(const ProtocolInfo& protocol, const LineDefaults& own) {
  std::vector<LineDefaults> guesses{own};
  const auto add_at = [&, shapes = shapes_of(protocol)](int baud) {
    for (const LineDefaults& shape : shapes)
      add_once(guesses, {baud, shape.data_bits, shape.parity, shape.stop_bits});
  };
  add_at(own.baud);
  const auto& known = protocol.speeds;
  for (const int baud : kLikelySpeeds)
    if (known.empty() || contains(known, baud)) add_at(baud);
  return guesses;
}

LinkConfig with_line(LinkConfig link, const LineDefaults& line) {
  auto& serial = std::get<SerialSettings>(link.channel);
  serial.baud = line.baud;
  serial.data_bits = line.data_bits;
  serial.parity = line.parity;
  serial.stop_bits = line.stop_bits;
  link.char_time = char_time_of(serial);
  return link;
}

std::string parity_word(Parity parity) {
  return std::string(config_keys::kParities[static_cast<std::size_t>(parity)]);
}

std::string_view station_key(const ProtocolInfo& protocol) {
  for (const std::string_view key : {"station", "unit"})
    if (option_named(protocol, key) != nullptr) return key;
  return {};
}

std::vector<std::int64_t> station_guesses(const ProtocolInfo& protocol, std::int64_t own) {
  std::vector<std::int64_t> guesses{own};
  const OptionSpec* option = option_named(protocol, station_key(protocol));
  if (option == nullptr) return guesses;
  const bool is_unit = option->key == "unit";
  // A device of Modbus TCP without a bus behind it answers 255 or 0.
  if (is_unit && !protocol.on_serial)
    for (const std::int64_t usual : {255, 1, 0}) add_once(guesses, usual);
  const std::int64_t first = is_unit ? 1 : option->min;  // 0 is a broadcast
  const std::int64_t last = is_unit ? kLastModbusUnit : option->max;
  for (std::int64_t each = first; each <= last; ++each) add_once(guesses, each);
  return guesses;
}

}  // namespace fxagent
