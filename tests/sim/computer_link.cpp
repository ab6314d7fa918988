#include "tests/sim/computer_link.h"

#include <algorithm>
#include <array>

namespace fxsim {
namespace {

constexpr std::uint8_t kStx = 0x02;
constexpr std::uint8_t kEtx = 0x03;
constexpr std::uint8_t kEot = 0x04;
constexpr std::uint8_t kEnq = 0x05;
constexpr std::uint8_t kAck = 0x06;
constexpr std::uint8_t kLf = 0x0A;
constexpr std::uint8_t kCl = 0x0C;
constexpr std::uint8_t kCr = 0x0D;
constexpr std::uint8_t kNak = 0x15;

// NAK codes, 12.4.1
constexpr std::uint8_t kSumError = 0x02;
constexpr std::uint8_t kProtocolError = 0x03;
constexpr std::uint8_t kAreaError = 0x06;
constexpr std::uint8_t kCharacterError = 0x07;
constexpr std::uint8_t kPcError = 0x10;
constexpr std::uint8_t kRemoteError = 0x18;

// The PLC's default time-out, D8129 = 0.
constexpr std::chrono::milliseconds kHalfFrameLife{100};
// Longer than any request of known length: 255 counters of eight digits.
constexpr std::size_t kMaxFrame = 2100;
constexpr std::size_t kHead = 7;  // station 2, PC 2, command 2, wait 1
constexpr std::string_view kAllStations = "FF";
constexpr unsigned kPointsPerWord = 16;
constexpr Device kGlobalSignal{Kind::special_m, 126};

enum class Shape : std::uint8_t { nothing, signal, text, read, write, list };
enum class Unit : std::uint8_t { none, bit, word };

struct Command {
  std::string_view name;
  Shape shape;
  Unit unit;
  unsigned device_characters;
};
constexpr auto kCommands = std::to_array<Command>({
    {"BR", Shape::read, Unit::bit, 5},
    {"WR", Shape::read, Unit::word, 5},
    {"QR", Shape::read, Unit::word, 7},
    {"BW", Shape::write, Unit::bit, 5},
    {"WW", Shape::write, Unit::word, 5},
    {"QW", Shape::write, Unit::word, 7},
    {"BT", Shape::list, Unit::bit, 5},
    {"WT", Shape::list, Unit::word, 5},
    {"QT", Shape::list, Unit::word, 7},
    {"RR", Shape::nothing, Unit::none, 0},
    {"RS", Shape::nothing, Unit::none, 0},
    {"PC", Shape::nothing, Unit::none, 0},
    {"GW", Shape::signal, Unit::none, 0},
    {"TT", Shape::text, Unit::none, 0},
});

const Command* find_command(std::string_view text) {
  if (text.size() < kHead) return nullptr;
  const auto found = std::ranges::find(kCommands, text.substr(4, 2), &Command::name);
  return found == kCommands.end() ? nullptr : &*found;
}

/// The maximum number of points per request, 7.7.1. `counter32` is CN200 and up, in words.
struct Limits {
  unsigned bits_read, words_read, bit_words_read, counters_read;
  unsigned bits_written, words_written, bit_words_written, counters_written;
  unsigned bits_listed, words_listed, text;
};
constexpr Limits kSmall{54, 13, 13, 6, 46, 11, 10, 5, 10, 6, 25};  // FX0N and FX1S
constexpr Limits kLarge{256, 64, 32, 32, 160, 64, 10, 32, 20, 10, 254};

const Limits& limits_of(const Model& model) {
  return model.name == "FX0N" || model.name == "FX1S" ? kSmall : kLarge;
}

/// Replies to PC, 8.8. The code of FX3S is in no manual we have; it is made up.
std::string_view type_code(const Model& model) {
  struct Row {
    std::string_view model;
    std::string_view code;
  };
  static constexpr auto kRows = std::to_array<Row>({
      {"FX0N", "8E"},
      {"FX1S", "F2"},
      {"FX1N", "9E"},
      {"FX2N", "9D"},
      {"FX3S", "F5"},
      {"FX3G", "F4"},
      {"FX3U", "F3"},
  });
  return std::ranges::find(kRows, model.name, &Row::model)->code;
}

bool is_bit(Kind kind) { return width(kind) == 1; }
/// Hex digits of one point of a word command.
std::size_t digits_of(Kind kind) { return kind == Kind::c_value32 ? 8 : 4; }

/// Parses "X0040", "TN123" or, in seven characters, "D000123": letters, then digits to the end.
std::optional<Device> device_in(std::string_view text) {
  const auto letters = text.find_first_of("0123456789");
  if (letters == 0 || letters > 2 || letters == std::string_view::npos) return std::nullopt;
  return parse_device(text);  // accepts leading zeros
}

bool takes(const Command& command, Kind kind) {
  switch (kind) {
    case Kind::x:
    case Kind::y:
    case Kind::m:
    case Kind::special_m:
    case Kind::s:
      return true;
    case Kind::t_contact:
    case Kind::c_contact:
      return command.unit == Unit::bit;
    case Kind::t_value:
    case Kind::c_value:
    case Kind::d:
    case Kind::special_d:
      return command.unit == Unit::word;
    case Kind::c_value32:
      return command.unit == Unit::word && command.shape != Shape::list;
    case Kind::r:
      return command.device_characters == 7;
    default:
      return false;  // coils of timers and counters: not on FX
  }
}

/// Characters of data per point; 0 if the device is unknown.
std::size_t data_size(const Command& command, std::string_view device) {
  if (command.unit == Unit::bit) return 1;
  const auto found = device_in(device);
  return found && found->kind == Kind::c_value32 ? 8 : 4;
}

/// The expected length of the character area.
struct Measure {
  std::optional<std::size_t> characters;  // nullopt: more characters are needed
  bool sound = true;  // false: no command has such an area; its length is unknown
};

Measure measure(const Command& command, std::string_view area) {
  const auto count_at = [area](std::size_t at) -> std::optional<std::uint32_t> {
    if (area.size() < at + 2) return std::nullopt;
    return parse_upper_hex(area.substr(at, 2)).value_or(0x100);
  };
  switch (command.shape) {
    case Shape::nothing:
      return {0};
    case Shape::signal:
      return {1};
    case Shape::read:
      return {command.device_characters + 2U};
    case Shape::text:
    case Shape::list: {
      const auto count = count_at(0);
      if (!count) return {std::nullopt};
      if (*count > 0xFF) return {std::nullopt, false};
      if (command.shape == Shape::text) return {2 + *count};
      const std::size_t data = command.unit == Unit::bit ? 1 : 4;
      return {2 + *count * (command.device_characters + data)};
    }
    case Shape::write: {
      const auto count = count_at(command.device_characters);
      if (!count) return {std::nullopt};
      if (*count > 0xFF) return {std::nullopt, false};
      const auto device = area.substr(0, command.device_characters);
      return {command.device_characters + 2 + *count * data_size(command, device)};
    }
  }
  return {std::nullopt, false};
}

/// True if a request ends here for a station that finds the end by the length alone. A request of
/// unknown length ends at once and is refused.
bool is_whole(std::string_view text, bool sum_check) {
  if (text.size() < kHead) return false;
  const auto* command = find_command(text);
  if (command == nullptr) return true;
  const auto size = measure(*command, text.substr(kHead));
  if (!size.sound) return true;
  return size.characters && text.size() >= kHead + *size.characters + (sum_check ? 2U : 0U);
}

bool starts_message(std::uint8_t byte) {
  return byte == kEnq || byte == kAck || byte == kNak || byte == kEot || byte == kCl;
}

class ComputerLinkFramer final : public Framer {
 public:
  explicit ComputerLinkFramer(ComputerLinkSettings settings) : settings_(settings) {}

  void take(std::uint8_t byte, TimePoint when, std::vector<Frame>& out) override {
    if (when - last_ > kHalfFrameLife) give_up(out);
    if (starts_message(byte)) give_up(out);  // resets the PLC's sequence
    last_ = when;
    if (frame_.empty() && !starts_message(byte)) {
      add_stray(byte, when, out);
      return;
    }
    frame_.push_back(byte);
    if (is_complete()) {
      finish(true, when, out);
    } else if (frame_.size() >= kMaxFrame) {
      give_up(out);
    }
  }

 private:
  bool is_complete() const {
    if (settings_.format == 4)  // CR and the next byte, which should be LF
      return frame_.size() > 2 && frame_[frame_.size() - 2] == kCr;
    if (frame_.front() == kEnq)
      return is_whole(as_text(ByteView(frame_).subspan(1)), settings_.sum_check);
    if (frame_.front() == kAck || frame_.front() == kNak) return frame_.size() == 5;
    return true;  // EOT, CL
  }

  ComputerLinkSettings settings_;
};

/// Returns the text of a request, between ENQ and CR LF.
std::string_view text_of(const Frame& frame, unsigned format) {
  const auto text = as_text(frame.bytes).substr(1);
  return format == 4 ? text.substr(0, text.size() - 2) : text;
}

/// One device, or the first of a word of bits, with the characters written to it.
struct Item {
  Device device;
  std::string_view data;
};

struct Access {
  const Command* command = nullptr;
  std::vector<Item> items;  // the points of a block or of a list
  bool bit_words = false;   // the points are words of 16 bits
  std::string wrong;        // if not empty: NAK 06, with this reason
};

Access fail(std::string why) {
  Access access;
  access.wrong = std::move(why);
  return access;
}

/// Returns why the model does not have the point (for a word of bits, all of its bits), or an empty
/// string if it does.
std::string missing(const Command& command, const DeviceMemory& memory, Device device) {
  if (!takes(command, device.kind)) return "device not for this command";
  const bool bit_word = command.unit == Unit::word && is_bit(device.kind);
  if (bit_word && device.number % 8 != 0) return "head number is no multiple of 8";
  const auto last = device.number + (bit_word ? kPointsPerWord - 1 : 0U);
  if (!memory.has(device) || !memory.has({device.kind, last})) return "no such device";
  return {};
}

unsigned most_points(const Command& command, Kind kind, const Limits& limits) {
  const bool reads = command.shape == Shape::read;
  if (command.unit == Unit::bit) return reads ? limits.bits_read : limits.bits_written;
  if (kind == Kind::c_value32) return reads ? limits.counters_read : limits.counters_written;
  if (is_bit(kind)) return reads ? limits.bit_words_read : limits.bit_words_written;
  return reads ? limits.words_read : limits.words_written;
}

Access block(const Command& command, std::string_view area, const DeviceMemory& memory) {
  const auto head = device_in(area.substr(0, command.device_characters));
  auto count = parse_upper_hex(area.substr(command.device_characters, 2)).value_or(0);
  const auto data = area.substr(command.device_characters + 2);
  if (!head) return fail("no device");
  if (command.name == "BR" && count == 0) count = 256;
  if (count == 0 || count > most_points(command, head->kind, limits_of(memory.model())))
    return fail("number of points out of range");
  Access access;
  access.command = &command;
  access.bit_words = command.unit == Unit::word && is_bit(head->kind);
  const std::size_t size = command.unit == Unit::bit ? 1 : digits_of(head->kind);
  for (unsigned i = 0; i < count; ++i) {
    const Device device{head->kind, head->number + i * (access.bit_words ? kPointsPerWord : 1U)};
    auto why = missing(command, memory, device);
    if (!why.empty()) return fail(std::move(why));
    access.items.push_back(
        {device, command.shape == Shape::write ? data.substr(i * size, size) : data});
  }
  return access;
}

Access list(const Command& command, std::string_view area, const DeviceMemory& memory) {
  const auto& limits = limits_of(memory.model());
  const auto count = parse_upper_hex(area.substr(0, 2)).value_or(0);
  if (count == 0 || count > (command.unit == Unit::bit ? limits.bits_listed : limits.words_listed))
    return fail("number of points out of range");
  Access access;
  access.command = &command;
  const std::size_t data = command.unit == Unit::bit ? 1 : 4;
  for (unsigned i = 0; i < count; ++i) {
    const auto item = area.substr(2 + i * (command.device_characters + data));
    const auto device = device_in(item.substr(0, command.device_characters));
    if (!device) return fail("no device");
    auto why = missing(command, memory, *device);
    if (!why.empty()) return fail(std::move(why));
    access.items.push_back({*device, item.substr(command.device_characters, data)});
  }
  return access;
}

/// Reads a word of 16 bits with the head device in the lowest; `head` is a multiple of 8.
std::uint32_t bits_from(const DeviceMemory& memory, Device head) {
  const std::size_t byte = head.number / 8;
  return memory.byte(head.kind, byte) | static_cast<std::uint32_t>(memory.byte(head.kind, byte + 1))
                                            << 8U;
}

std::string read_points(const Access& access, const DeviceMemory& memory) {
  Bytes out;
  for (const auto& [device, unused] : access.items) {
    if (access.command->unit == Unit::bit) {
      out.push_back(memory.get(device) != 0 ? '1' : '0');
      continue;
    }
    const auto value = access.bit_words ? bits_from(memory, device) : memory.get(device);
    for (auto shift = static_cast<int>(digits_of(device.kind)) * 4 - 8; shift >= 0; shift -= 8)
      append_hex(out, static_cast<std::uint8_t>(value >> static_cast<unsigned>(shift)));
  }
  return std::string(as_text(out));
}

/// Returns the raw values, or nullopt if a character is not valid data.
std::optional<std::vector<std::uint32_t>> values_in(const Access& access) {
  std::vector<std::uint32_t> values;
  for (const auto& item : access.items) {
    const auto value = parse_upper_hex(item.data);
    if (!value || (access.command->unit == Unit::bit && *value > 1)) return std::nullopt;
    values.push_back(*value);
  }
  return values;
}

void write_points(const Access& access, const std::vector<std::uint32_t>& values, Plc& plc) {
  for (std::size_t i = 0; i < values.size(); ++i) {
    const auto device = access.items[i].device;
    if (access.command->unit == Unit::word && is_bit(device.kind)) {
      plc.write_byte(device.kind, device.number / 8, static_cast<std::uint8_t>(values[i]));
      plc.write_byte(device.kind, device.number / 8 + 1,
                     static_cast<std::uint8_t>(values[i] >> 8U));
    } else {
      plc.write(device, values[i]);
    }
  }
}

/// Fills in device, count and values for the log; words of bits are logged bit by bit.
void describe(Ruling& ruling, const Access& access, const std::vector<std::uint32_t>& values) {
  ruling.device = device_name(access.items.front().device);
  ruling.count =
      static_cast<unsigned>(access.items.size()) * (access.bit_words ? kPointsPerWord : 1U);
  for (const auto value : values) {
    if (!access.bit_words) {
      ruling.values.push_back(value);
      continue;
    }
    for (unsigned bit = 0; bit < kPointsPerWord; ++bit)
      ruling.values.push_back((value >> bit) & 1U);
  }
}

class ComputerLink final : public Personality {
 public:
  explicit ComputerLink(ComputerLinkSettings settings) : settings_(settings) {}

  Protocol protocol() const override { return Protocol::computer_link; }
  std::unique_ptr<Framer> make_framer() const override {
    return std::make_unique<ComputerLinkFramer>(settings_);
  }

  bool hears(const Frame& frame) const override {
    const auto first = frame.bytes.front();
    if (first == kEot || first == kCl) return true;
    const auto station = as_text(frame.bytes).substr(1, 2);
    return station == kAllStations || parse_upper_hex(station) == settings_.station;
  }

  RequestKind kind(const Frame& frame) const override {
    if (!frame.whole) return RequestKind::malformed;
    if (frame.bytes.front() != kEnq) return RequestKind::handshake;
    const auto text = text_of(frame, settings_.format);
    const auto* command = find_command(text);
    if (command == nullptr || command->name == "PC" || command->name == "TT")
      return RequestKind::other;
    if (command->unit == Unit::none) return RequestKind::control;
    if (command->shape == Shape::read) return RequestKind::read;
    if (command->unit == Unit::bit) {
      const auto area = text.substr(kHead);
      const bool block = command->shape == Shape::write;
      const std::size_t count_at = block ? command->device_characters : 0;
      const std::size_t state_at = command->device_characters + 2U;  // of the first point, in both
      if (area.size() > state_at && area.substr(count_at, 2) == "01")
        return area[state_at] == '1' ? RequestKind::force_on : RequestKind::force_off;
    }
    return RequestKind::write;
  }

  Ruling execute(const Frame& frame, Plc& plc) const override {
    const auto silence = [](std::string why) {
      return Ruling{.verdict = Verdict::silent, .why = std::move(why)};
    };
    if (!frame.whole) return silence("no frame");
    if (frame.bytes.front() != kEnq) return silence("of the master");

    const auto text = text_of(frame, settings_.format);
    const auto& model = plc.memory().model();
    const auto* command = find_command(text);
    if (text.size() < kHead) return silence("incomplete");
    if (text.starts_with(kAllStations) && (command == nullptr || command->name != "GW"))
      return silence("all stations are addressed");
    const auto wait = parse_upper_hex(text.substr(6, 1));
    const auto answer = [&](Ruling ruling) {
      ruling.wait = std::chrono::milliseconds(10) * wait.value_or(0);
      return ruling;
    };

    auto area = text.substr(kHead);
    const auto size = command != nullptr ? measure(*command, area) : Measure{std::nullopt, false};
    const bool ends_by_length = settings_.format == 1;
    if (settings_.sum_check && (size.sound || !ends_by_length)) {
      const auto sum = parse_upper_hex(text.substr(text.size() - 2));
      if (area.size() < 2 || sum != sum_of(ByteView(frame.bytes).subspan(1, text.size() - 2)))
        return answer(nak(kSumError, "wrong sum"));
      area.remove_suffix(2);
    }
    if (!ends_by_length && frame.bytes.back() != kLf)
      return answer(nak(kProtocolError, "CR without LF"));
    if (command == nullptr) return answer(nak(kAreaError, "no such command"));
    if (command->device_characters == 7 && model.extended != ExtendedSet::fx3)
      return answer(nak(kAreaError, "not on this model"));
    if (!wait) return answer(nak(kAreaError, "message wait is no digit"));
    if (!size.sound || size.characters != area.size())
      return answer(nak(kAreaError, "length of the character area"));

    Access access;
    std::vector<std::uint32_t> values;
    if (command->unit != Unit::none) {
      access = command->shape == Shape::list ? list(*command, area, plc.memory())
                                             : block(*command, area, plc.memory());
      if (!access.wrong.empty()) return answer(nak(kAreaError, access.wrong));
      if (command->shape != Shape::read) {
        auto given = values_in(access);
        if (!given) return answer(nak(kCharacterError, "data are no digits"));
        values = std::move(*given);
      }
    } else if (command->shape == Shape::text &&
               (area.size() == 2 || area.size() - 2 > limits_of(model).text)) {
      return answer(nak(kAreaError, "number of characters out of range"));
    }
    if (text.substr(2, 2) != "FF") return answer(nak(kPcError, "PC number is not FF"));

    Ruling ruling{.verdict = Verdict::ack, .reply = closed(begun(kAck))};
    if (command->name == "RR") {
      if (!plc.force_run()) return answer(nak(kRemoteError, "RUN already, or switch in RUN"));
    } else if (command->name == "RS") {
      if (!plc.force_stop()) return answer(nak(kRemoteError, "not in forced RUN"));
    } else if (command->name == "GW") {
      if (area != "0" && area != "1") return silence("signal is neither 0 nor 1");
      plc.force(kGlobalSignal, area == "1");
      ruling.reply.clear();
    } else if (command->name == "PC") {
      ruling = {.verdict = Verdict::data, .reply = data_reply(type_code(model))};
    } else if (command->name == "TT") {
      ruling = {.verdict = Verdict::data, .reply = data_reply(area)};
    } else if (command->shape == Shape::read) {
      ruling = {.verdict = Verdict::data, .reply = data_reply(read_points(access, plc.memory()))};
      describe(ruling, access, {});
    } else {
      write_points(access, values, plc);
      describe(ruling, access, values);
    }
    return answer(std::move(ruling));
  }

  Bytes refusal(const Frame& frame, std::optional<std::uint16_t> code) const override {
    if (as_text(frame.bytes).substr(1, 2) == kAllStations) return {};
    return nak(static_cast<std::uint8_t>(code.value_or(kAreaError)), {}).reply;
  }

  void spoil(Bytes& reply, Flaw flaw) const override {
    if (reply.size() < 5) return;
    const bool summed = settings_.sum_check && reply.front() == kStx;
    const std::size_t tail = settings_.format == 4 ? 2 : 0;
    if (flaw == Flaw::sum && summed) {
      auto& last = reply[reply.size() - tail - 1];
      last = static_cast<std::uint8_t>(last == '0' ? '1' : '0');
    } else if (flaw == Flaw::sum) {
      reply.front() = static_cast<std::uint8_t>(reply.front() ^ 0x01U);  // ACK arrives as 07
    } else if (flaw == Flaw::sender) {
      Bytes other;
      append_hex(other, static_cast<std::uint8_t>((settings_.station + 1) % 16));
      std::ranges::copy(other, reply.begin() + 1);
      if (!summed) return;
      reply.resize(reply.size() - tail - 2);
      reply = closed(std::move(reply));
    }
  }

 private:
  /// Returns the beginning of every message: control code, station and PC number.
  Bytes begun(std::uint8_t control) const {
    Bytes message{control};
    append_hex(message, static_cast<std::uint8_t>(settings_.station));
    message.insert(message.end(), {'F', 'F'});
    return message;
  }

  /// Appends the sum, if the message has one, and the end of the message.
  Bytes closed(Bytes message) const {
    if (settings_.sum_check && message.front() == kStx)
      append_hex(message, sum_of(ByteView(message).subspan(1)));
    if (settings_.format == 4) message.insert(message.end(), {kCr, kLf});
    return message;
  }

  Bytes data_reply(std::string_view data) const {
    auto message = begun(kStx);
    message.insert(message.end(), data.begin(), data.end());
    message.push_back(kEtx);
    return closed(std::move(message));
  }

  Ruling nak(std::uint8_t code, std::string why) const {
    auto message = begun(kNak);
    append_hex(message, code);
    return {.verdict = Verdict::nak, .reply = closed(std::move(message)), .why = std::move(why)};
  }

  ComputerLinkSettings settings_;
};

}  // namespace

std::unique_ptr<Personality> make_computer_link(ComputerLinkSettings settings) {
  return std::make_unique<ComputerLink>(settings);
}

}  // namespace fxsim
