#include "tests/sim/programming_port.h"

#include <algorithm>
#include <array>
#include <span>

namespace fxsim {
namespace {

constexpr std::uint8_t kStx = 0x02;
constexpr std::uint8_t kEtx = 0x03;
constexpr std::uint8_t kEnq = 0x05;
constexpr std::uint8_t kAck = 0x06;
constexpr std::uint8_t kNak = 0x15;

// The longest frame is a write of 254 bytes by E10; in anything longer the ETX was lost.
constexpr std::size_t kMaxFrame = 1 + 3 + 4 + 2 + 2 * 254 + 1 + 2;
// KunYi's FX3U firmware discards half a frame after this much silence.
constexpr std::chrono::milliseconds kHalfFrameLife{200};
constexpr unsigned kMaxBytes = 0x40;        // per frame, all FX
constexpr unsigned kMaxFx3ReadBytes = 254;  // E00 on an FX3U, as captured

/// A row of devices in a map of byte addresses or, for forces, of bit addresses.
struct Area {
  Kind kind;
  std::uint32_t base;  // address of the row's first byte or bit
  std::uint32_t size;  // bytes or bits
};

constexpr auto kClassic = std::to_array<Area>({
    {Kind::s, 0x0000, 0x80},
    {Kind::x, 0x0080, 0x20},
    {Kind::y, 0x00A0, 0x20},
    {Kind::t_contact, 0x00C0, 0x20},
    {Kind::m, 0x0100, 0xC0},  // M0 to M1535
    {Kind::c_contact, 0x01C0, 0x20},
    {Kind::special_m, 0x01E0, 0x20},
    {Kind::t_coil, 0x02C0, 0x20},
    {Kind::c_coil, 0x03C0, 0x20},
    {Kind::t_value, 0x0800, 0x200},
    {Kind::c_value, 0x0A00, 400},
    {Kind::c_value32, 0x0C00, 224},
    {Kind::special_d, 0x0E00, 0x200},
    {Kind::d, 0x1000, 0x800},  // D0 to D1023
});
constexpr auto kClassicForces = std::to_array<Area>({
    {Kind::s, 0x0000, 1024},
    {Kind::x, 0x0400, 256},
    {Kind::y, 0x0500, 256},
    {Kind::t_contact, 0x0600, 256},
    {Kind::m, 0x0800, 1536},
    {Kind::c_contact, 0x0E00, 256},
    {Kind::special_m, 0x0F00, 256},
    {Kind::t_coil, 0x1600, 256},
    {Kind::c_coil, 0x1E00, 256},
});

constexpr auto kFx1nFx2n = std::to_array<Area>({
    {Kind::m, 0x0000, 0x180},  // M0 to M3071
    {Kind::y, 0x0180, 0x20},
    {Kind::special_m, 0x01C0, 0x20},
    {Kind::c_contact, 0x01E0, 0x20},
    {Kind::t_contact, 0x0200, 0x20},
    {Kind::x, 0x0240, 0x20},
    {Kind::s, 0x0280, 0x80},
    {Kind::c_coil, 0x04E0, 0x20},
    {Kind::t_coil, 0x0500, 0x20},
    {Kind::c_value, 0x0A00, 400},
    {Kind::c_value32, 0x0C00, 224},
    {Kind::special_d, 0x0E00, 0x200},
    {Kind::t_value, 0x1000, 0x200},
    {Kind::d, 0x4000, 0x3E80},  // D0 to D7999
});
constexpr auto kFx1nFx2nForces = std::to_array<Area>({
    {Kind::m, 0x0000, 3072},
    {Kind::y, 0x0C00, 256},
    {Kind::special_m, 0x0E00, 256},
    {Kind::c_contact, 0x0F00, 256},
    {Kind::t_contact, 0x1000, 256},
    {Kind::x, 0x1200, 256},
    {Kind::s, 0x1400, 1024},
    {Kind::c_coil, 0x2700, 256},
    {Kind::t_coil, 0x2800, 256},
});

constexpr auto kFx3 = std::to_array<Area>({
    {Kind::c_value, 0x0A00, 400},
    {Kind::c_value32, 0x0C00, 224},
    {Kind::t_value, 0x1000, 0x400},
    {Kind::d, 0x4000, 0x3E80},
    {Kind::special_d, 0x8000, 0x400},
    {Kind::m, 0x8800, 0x3C0},  // M0 to M7679
    {Kind::y, 0x8BC0, 0x20},
    {Kind::special_m, 0x8C00, 0x40},
    {Kind::x, 0x8CA0, 0x20},
    {Kind::s, 0x8CE0, 0x200},
    {Kind::c_coil, 0x92E0, 0x20},
    {Kind::t_coil, 0x9300, 0x40},
    {Kind::c_contact, 0x9340, 0x20},
    {Kind::t_contact, 0x9360, 0x40},
});
constexpr auto kFx3Forces = std::to_array<Area>({
    {Kind::m, 0x4000, 7680},
    {Kind::y, 0x5E00, 256},
    {Kind::special_m, 0x6000, 512},
    {Kind::x, 0x6500, 256},
    {Kind::s, 0x6700, 4096},
    {Kind::c_coil, 0x9700, 256},
    {Kind::t_coil, 0x9800, 512},
    {Kind::c_contact, 0x9A00, 256},
    {Kind::t_contact, 0x9B00, 512},
});

struct Maps {
  std::span<const Area> bytes;
  std::span<const Area> bits;
};
constexpr auto kMaps = std::to_array<Maps>({
    // by CommandSet
    {kClassic, kClassicForces},
    {kFx1nFx2n, kFx1nFx2nForces},
    {kFx3, kFx3Forces},
});

const Maps& maps_of(CommandSet set) { return kMaps[static_cast<std::size_t>(set)]; }

/// Returns the area that has the address, or null.
const Area* area_at(std::span<const Area> map, std::uint32_t address) {
  const auto found = std::ranges::find_if(map, [address](const Area& area) {
    return address >= area.base && address < area.base + area.size;
  });
  return found == map.end() ? nullptr : &*found;
}

/// Returns the text of a whole frame between STX and ETX.
std::string_view payload(const Frame& frame) {
  if (frame.bytes.size() < 4) return {};
  return as_text(ByteView(frame.bytes).subspan(1, frame.bytes.size() - 4));
}

struct Command {
  RequestKind kind = RequestKind::other;
  bool extended = false;
  std::string_view rest;  // after the characters of the command
};

Command split(std::string_view text) {
  struct Row {
    std::string_view prefix;
    RequestKind kind;
    bool extended;
  };
  // E0 and E1 have two digits: the second is 0 for devices and 1 for the program.
  static constexpr auto kRows = std::to_array<Row>({
      {"E00", RequestKind::read, true},
      {"E10", RequestKind::write, true},
      {"E7", RequestKind::force_on, true},
      {"E8", RequestKind::force_off, true},
      {"0", RequestKind::read, false},
      {"1", RequestKind::write, false},
      {"7", RequestKind::force_on, false},
      {"8", RequestKind::force_off, false},
  });
  for (const auto& row : kRows)
    if (text.starts_with(row.prefix))
      return {row.kind, row.extended, text.substr(row.prefix.size())};
  return {RequestKind::other, false, text};
}

class ProgrammingPortFramer final : public Framer {
 public:
  void take(std::uint8_t byte, TimePoint when, std::vector<Frame>& out) override {
    if (when - last_ > kHalfFrameLife) give_up(out);
    last_ = when;        // after give_up(), which needs the end of the lost frame
    if (byte == kEnq) {  // resets any reception in progress
      give_up(out);
      out.push_back({{kEnq}, true, when});
      return;
    }
    if (byte == kStx) {
      give_up(out);
      frame_.push_back(byte);
      after_etx_ = 0;
      return;
    }
    if (frame_.empty()) {
      add_stray(byte, when, out);
      return;
    }
    frame_.push_back(byte);
    if (after_etx_ > 0) {
      if (++after_etx_ == 3) finish(true, when, out);
      return;
    }
    if (byte == kEtx) {
      after_etx_ = 1;
    } else if (byte < 0x20 || byte > 0x7E || frame_.size() >= kMaxFrame) {
      give_up(out);
    }
  }

 private:
  int after_etx_ = 0;  // 1 at the ETX, plus one for each digit of the sum
};

Ruling refuse(std::string why) {
  return {.verdict = Verdict::nak, .reply = {kNak}, .why = std::move(why)};
}

/// Fills in the first device, count and raw values of bytes in one row; values only if the bytes
/// cover whole devices.
void describe(Ruling& ruling, ByteAt first, std::size_t size, ByteView data) {
  const auto bits = width(first.kind);
  ruling.device = device_name({first.kind, static_cast<unsigned>(first.offset * 8 / bits)});
  ruling.count = static_cast<unsigned>(size * 8 / bits);
  const std::size_t step = bits / 8;
  if (data.empty()) return;
  if (bits == 1) {
    for (const auto byte : data)
      for (unsigned bit = 0; bit < 8; ++bit) ruling.values.push_back((byte >> bit) & 1U);
    return;
  }
  if (first.offset % step != 0 || size % step != 0) return;
  for (std::size_t i = 0; i < size; i += step) {
    std::uint32_t value = 0;
    for (std::size_t j = 0; j < step; ++j)
      value |= static_cast<std::uint32_t>(data[i + j]) << (8 * j);
    ruling.values.push_back(value);
  }
}

Ruling force(const Command& command, CommandSet set, Plc& plc) {
  const auto digits = parse_upper_hex(command.rest);
  if (command.rest.size() != 4 || !digits) return refuse("a force takes four hex digits");
  const std::uint32_t address = ((*digits & 0xFFU) << 8U) | (*digits >> 8U);  // low byte first
  const auto device = bit_at(set, address);
  if (!device || !plc.memory().has(*device)) return refuse("no such bit");
  const bool on = command.kind == RequestKind::force_on;
  plc.force(*device, on);
  return {.verdict = Verdict::ack,
          .reply = {kAck},
          .device = device_name(*device),
          .count = 1,
          .values = {on ? 1U : 0U}};
}

Ruling access(const Command& command, CommandSet set, Plc& plc) {
  const auto& model = plc.memory().model();
  const auto address = parse_upper_hex(command.rest.substr(0, 4));
  const auto size =
      parse_upper_hex(command.rest.substr(std::min<std::size_t>(4, command.rest.size()), 2));
  if (command.rest.size() < 6 || !address || !size)
    return refuse("address and count are six hex digits");
  const bool reads = command.kind == RequestKind::read;
  const bool long_reads = reads && command.extended && model.extended == ExtendedSet::fx3;
  if (*size == 0 || *size > (long_reads ? kMaxFx3ReadBytes : kMaxBytes))
    return refuse("byte count out of range");

  const auto text = command.rest.substr(6);
  if (text.size() != (reads ? 0 : 2 * *size)) return refuse("length does not fit the byte count");
  Bytes data;
  for (std::size_t i = 0; i < text.size(); i += 2) {
    const auto byte = parse_upper_hex(text.substr(i, 2));
    if (!byte) return refuse("data is not upper-case hex");
    data.push_back(static_cast<std::uint8_t>(*byte));
  }

  std::vector<ByteAt> places;
  bool one_row = true;
  for (std::uint32_t i = 0; i < *size; ++i) {
    const auto place = byte_at(set, *address + i);
    if (!place || !plc.memory().has_byte(place->kind, place->offset))
      return refuse("no such device on this model");
    one_row = one_row && (places.empty() || places.front().kind == place->kind);
    places.push_back(*place);
  }

  Ruling ruling;
  describe(ruling, places.front(), *size, one_row ? ByteView(data) : ByteView());
  if (!reads) {
    for (std::size_t i = 0; i < places.size(); ++i)
      plc.write_byte(places[i].kind, places[i].offset, data[i]);
    ruling.verdict = Verdict::ack;
    ruling.reply = {kAck};
    return ruling;
  }
  ruling.verdict = Verdict::data;
  ruling.reply.push_back(kStx);
  for (const auto& place : places)
    append_hex(ruling.reply, plc.memory().byte(place.kind, place.offset));
  ruling.reply.push_back(kEtx);
  append_hex(ruling.reply, sum_of(ByteView(ruling.reply).subspan(1)));
  return ruling;
}

class ProgrammingPort final : public Personality {
 public:
  Protocol protocol() const override { return Protocol::programming_port; }
  bool hears(const Frame&) const override { return true; }  // the protocol has no addresses
  std::unique_ptr<Framer> make_framer() const override {
    return std::make_unique<ProgrammingPortFramer>();
  }

  RequestKind kind(const Frame& frame) const override {
    if (!frame.whole) return RequestKind::malformed;
    if (frame.bytes.size() == 1) return RequestKind::enquire;
    return split(payload(frame)).kind;
  }

  Ruling execute(const Frame& frame, Plc& plc) const override {
    if (!frame.whole) return {.verdict = Verdict::silent, .why = "no frame"};
    if (frame.bytes.size() == 1) return {.verdict = Verdict::ack, .reply = {kAck}};

    const ByteView bytes = frame.bytes;
    const auto sum = parse_upper_hex(as_text(bytes.last(2)));
    if (!sum || *sum != sum_of(bytes.subspan(1, bytes.size() - 3))) return refuse("wrong sum");

    const auto command = split(payload(frame));
    if (command.kind == RequestKind::other)
      return refuse("command '" + std::string(payload(frame).substr(0, 3)) +
                    "' is not device access");
    auto set = CommandSet::classic;
    if (command.extended) {
      const auto extended = plc.memory().model().extended;
      if (extended == ExtendedSet::none) return refuse("this model has no E commands");
      set = extended == ExtendedSet::fx3 ? CommandSet::fx3 : CommandSet::fx1n_fx2n;
    }
    if (command.kind == RequestKind::force_on || command.kind == RequestKind::force_off)
      return force(command, set, plc);
    return access(command, set, plc);
  }

  Bytes refusal(const Frame&, std::optional<std::uint16_t>) const override { return {kNak}; }
  void spoil(Bytes& reply, Flaw flaw) const override {
    if (reply.empty() || flaw != Flaw::sum) return;
    // Changes the last digit of the sum: 0 and 1, A and @ and so on differ in the lowest bit. An
    // ACK has no sum: it arrives as the neighbouring code, as after a bit error that parity missed.
    auto& last = reply.back();
    last = reply.size() == 1 ? static_cast<std::uint8_t>(last ^ 0x01U)
                             : static_cast<std::uint8_t>(last == '0' ? '1' : '0');
  }
};

}  // namespace

std::optional<ByteAt> byte_at(CommandSet set, std::uint32_t address) {
  const auto* area = area_at(maps_of(set).bytes, address);
  if (area == nullptr) return std::nullopt;
  return ByteAt{area->kind, address - area->base};
}

std::optional<Device> bit_at(CommandSet set, std::uint32_t address) {
  const auto* area = area_at(maps_of(set).bits, address);
  if (area == nullptr) return std::nullopt;
  return Device{area->kind, address - area->base};
}

std::unique_ptr<Personality> make_programming_port() { return std::make_unique<ProgrammingPort>(); }

}  // namespace fxsim
