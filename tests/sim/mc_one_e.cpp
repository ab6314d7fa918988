#include "tests/sim/mc.h"

#include <algorithm>
#include <array>

#include "tests/sim/mc_device.h"

namespace fxsim {
namespace {

constexpr unsigned kPointsPerWord = 16;
constexpr std::uint32_t kAnswer = 0x80;
constexpr std::uint32_t kHighestCommand = 0x1F;  // higher numbers are not 1E frames
constexpr std::uint8_t kModelFx3u = 0xF3;
constexpr std::uint8_t kModelFx3g = 0xF4;

constexpr std::uint16_t kNoCommand = 0x50;
constexpr std::uint16_t kNoDigits = 0x54;
constexpr std::uint16_t kWriteInRun = 0x55;
constexpr std::uint16_t kNoDevice = 0x56;
constexpr std::uint16_t kPoints = 0x57;
constexpr std::uint16_t kHeadNumber = 0x58;
constexpr std::uint16_t kPcNumber = 0x5B;
constexpr std::uint16_t kAbnormalPc = 0x10;
constexpr std::uint16_t kUsualRefusal = kWriteInRun;

enum class Shape : std::uint8_t { row, list, header, loopback, none };

struct Command {
  std::uint32_t number;
  Shape shape;
  bool bits;
  bool writes;
  unsigned most;           // points
  unsigned most_of_words;  // where words consist of bit devices
};

constexpr auto kCommands = std::to_array<Command>({
    {0x00, Shape::row, true, false, 256, 0},
    {0x01, Shape::row, false, false, 64, 32},
    {0x02, Shape::row, true, true, 160, 0},
    {0x03, Shape::row, false, true, 64, 10},
    {0x04, Shape::list, true, true, 80, 0},
    {0x05, Shape::list, false, true, 10, 10},
    {0x13, Shape::header, false, false, 0, 0},
    {0x14, Shape::header, false, false, 0, 0},
    {0x15, Shape::header, false, false, 0, 0},
    {0x16, Shape::loopback, false, false, 0, 0},
});

Command command_of(std::uint32_t number) {
  const auto found = std::ranges::find(kCommands, number, &Command::number);
  return found == kCommands.end() ? Command{number, Shape::none, false, false, 0, 0} : *found;
}

/// Converts the device's letters, padded with blanks, as one number: "D " is 4420.
std::optional<Device> device_of(std::uint32_t letters, std::uint32_t number) {
  struct Row {
    std::uint32_t letters;
    Kind kind;
  };
  constexpr auto kRows = std::to_array<Row>({
      {0x5820, Kind::x},
      {0x5920, Kind::y},
      {0x4D20, Kind::m},
      {0x5320, Kind::s},
      {0x5453, Kind::t_contact},
      {0x5443, Kind::t_coil},
      {0x544E, Kind::t_value},
      {0x4353, Kind::c_contact},
      {0x4343, Kind::c_coil},
      {0x434E, Kind::c_value},
      {0x4420, Kind::d},
      {0x5220, Kind::r},
  });
  const auto row = std::ranges::find(kRows, letters, &Row::letters);
  if (row == kRows.end()) return std::nullopt;
  return fx_device(row->kind, number);
}

struct Item {
  std::optional<Device> device;
  std::uint32_t number = 0;  // as in the request
  std::uint32_t value = 0;
};

struct Request {
  Command command{};
  std::uint32_t pc = 0xFF;
  unsigned points = 0;
  Item head{};
  std::vector<Item> items{};            // of a random access
  std::vector<std::uint32_t> values{};  // of a write to consecutive devices
  Bytes text{};
  bool cut_off = false;
  bool unreadable = false;
  std::size_t left = 0;
};

Item read_device(McReader& in) {
  Item item;
  std::uint32_t letters = 0;
  if (in.code() == McCode::ascii) {
    letters = in.number(2);
    item.number = in.number(4);
  } else {
    item.number = in.number(4);
    letters = in.number(2);
  }
  item.device = device_of(letters, item.number);
  return item;
}

Request request_of(ByteView frame, McCode code) {
  McReader in(frame, code);
  Request request;
  request.command = command_of(in.number(1));
  request.pc = in.number(1);
  in.number(2);  // the monitoring timer
  const auto& command = request.command;
  if (command.shape == Shape::row) {
    request.head = read_device(in);
    request.points = in.number(1);
    in.number(1);
    if (request.points == 0) request.points = 256;
    if (command.writes && command.bits) {
      // An odd number of points is padded, in ASCII too.
      request.values = in.points(request.points + (code == McCode::ascii ? request.points % 2 : 0));
      request.values.resize(request.points);
    } else if (command.writes) {
      for (unsigned i = 0; i < request.points && !in.cut_off(); ++i)
        request.values.push_back(in.number(2));
    }
  } else if (command.shape == Shape::list) {
    request.points = in.number(1);
    in.number(1);
    for (unsigned i = 0; i < request.points && !in.cut_off(); ++i) {
      auto item = read_device(in);
      item.value = in.number(command.bits ? 1 : 2);
      request.items.push_back(item);
    }
  } else if (command.shape == Shape::loopback) {
    request.points = in.number(1);
    const auto text = in.raw(request.points * (code == McCode::ascii ? 2U : 1U));
    request.text.assign(text.begin(), text.end());
  }
  request.cut_off = in.cut_off();
  request.unreadable = in.unreadable();
  request.left = in.left();
  return request;
}

/// A frame has no length field: its end follows from the command. Bytes that do not begin a 1E
/// frame make the rest of the connection unreadable.
class OneEFramer final : public Framer {
 public:
  explicit OneEFramer(McCode code) : code_(code) {}

  void take(std::uint8_t byte, TimePoint when, std::vector<Frame>& out) override {
    if (lost_) {
      add_stray(byte, when, out);
      return;
    }
    frame_.push_back(byte);
    McReader in(frame_, code_);
    const auto number = in.number(1);
    if (in.cut_off()) return;
    lost_ = in.unreadable() || number > kHighestCommand;
    if (lost_) {
      finish(false, when, out);
      return;
    }
    const auto request = request_of(frame_, code_);
    if (request.cut_off) return;
    lost_ = request.command.shape == Shape::none;  // the end of this frame is unknown
    finish(true, when, out);
  }

 private:
  McCode code_;
};

/// One request, carried out on one PLC.
class Access final {
 public:
  Access(const Request& request, const std::vector<Hole>& holes, const DeviceMemory& memory)
      : request_(request), command_(request.command), holes_(holes), memory_(memory) {}

  /// Returns the end code; 0 if the request is valid.
  std::uint16_t objection() const {
    if (request_.unreadable) return kNoDigits;
    if (command_.shape == Shape::row) return row_objection();
    if (command_.shape == Shape::list) return list_objection();
    return 0;
  }

  /// The number of devices of the head's row that the request touches.
  unsigned devices() const {
    const auto kind = request_.head.device->kind;
    if (command_.bits) return request_.points;
    if (is_bit(kind)) return request_.points * kPointsPerWord;
    return kind == Kind::c_value32 ? request_.points / 2 : request_.points;
  }

 private:
  std::uint16_t row_objection() const {
    const auto& head = request_.head;
    if (!head.device || !memory_.has(*head.device)) return kNoDevice;
    const auto kind = head.device->kind;
    if (command_.bits != is_bit(kind) && command_.bits) return kHeadNumber;
    const bool bit_words = !command_.bits && is_bit(kind);
    if (bit_words && head.number % kPointsPerWord != 0) return kHeadNumber;
    if (request_.points > (bit_words ? command_.most_of_words : command_.most)) return kPoints;
    if (kind == Kind::c_value32 && request_.points % 2 != 0) return kPoints;
    if (!is_there(memory_, holes_, *head.device, devices())) return kPoints;
    return values_objection();
  }

  std::uint16_t values_objection() const {
    if (command_.bits && std::ranges::any_of(request_.values, [](auto value) { return value > 1; }))
      return kPoints;
    return 0;
  }

  std::uint16_t list_objection() const {
    if (request_.points == 0 || request_.points > command_.most) return kPoints;
    for (const auto& [device, number, value] : request_.items) {
      if (!device || device->kind == Kind::c_value32) return kNoDevice;
      const bool bit_words = !command_.bits && is_bit(device->kind);
      if (command_.bits && !is_bit(device->kind)) return kHeadNumber;
      if (bit_words && number % kPointsPerWord != 0) return kHeadNumber;
      if (!is_there(memory_, holes_, *device, bit_words ? kPointsPerWord : 1)) return kNoDevice;
      if (command_.bits && value > 1) return kPoints;
    }
    return 0;
  }

  const Request& request_;
  const Command& command_;
  const std::vector<Hole>& holes_;
  const DeviceMemory& memory_;
};

Bytes data_of(const Request& request, const DeviceMemory& memory, McCode code) {
  Bytes data;
  const auto head = *request.head.device;
  if (request.command.bits) {
    std::vector<std::uint32_t> points(request.points);
    for (unsigned i = 0; i < request.points; ++i)
      points[i] = memory.get({head.kind, head.number + i});
    if (code == McCode::ascii && points.size() % 2 != 0) points.push_back(0);
    append_mc_points(data, code, points);
  } else if (head.kind == Kind::c_value32) {
    for (unsigned i = 0; i < request.points; ++i)
      append_mc(data, code, memory.get({head.kind, head.number + i / 2}) >> (16 * (i % 2)), 2);
  } else {
    const auto step = is_bit(head.kind) ? kPointsPerWord : 1U;
    for (unsigned i = 0; i < request.points; ++i)
      append_mc(data, code, word_at(memory, {head.kind, head.number + i * step}), 2);
  }
  return data;
}

/// Writes one point or word and appends the written values to `told`, device by device.
void put(Plc& plc, Device device, bool bits, std::uint32_t value,
         std::vector<std::uint32_t>& told) {
  if (!bits && is_bit(device.kind)) {
    set_word_at(plc, device, value);
    for (unsigned i = 0; i < kPointsPerWord; ++i) told.push_back((value >> i) & 1U);
    return;
  }
  plc.write(device, value);
  told.push_back(value);
}

std::vector<std::uint32_t> write(const Request& request, Plc& plc) {
  std::vector<std::uint32_t> told;
  const bool bits = request.command.bits;
  for (const auto& item : request.items) put(plc, *item.device, bits, item.value, told);
  if (request.items.empty()) {
    const auto head = *request.head.device;
    const auto& values = request.values;
    const bool counters = head.kind == Kind::c_value32;
    const auto step = !bits && is_bit(head.kind) ? kPointsPerWord : 1U;
    for (unsigned i = 0; counters && i + 1 < values.size(); i += 2)
      put(plc, {head.kind, head.number + i / 2}, bits, values[i] | values[i + 1] << 16U, told);
    for (unsigned i = 0; !counters && i < values.size(); ++i)
      put(plc, {head.kind, head.number + i * step}, bits, values[i], told);
  }
  return told;
}

class McOneE final : public Personality {
 public:
  explicit McOneE(McSettings settings) : settings_(std::move(settings)) {}

  Protocol protocol() const override { return Protocol::mc_1e; }
  bool hears(const Frame&) const override { return true; }
  std::unique_ptr<Framer> make_framer() const override {
    return std::make_unique<OneEFramer>(settings_.code);
  }

  RequestKind kind(const Frame& frame) const override {
    if (!frame.whole) return RequestKind::malformed;
    const auto request = request_of(frame.bytes, settings_.code);
    const auto& command = request.command;
    if (command.number == 0x13 || command.number == 0x14) return RequestKind::control;
    if (command.shape != Shape::row && command.shape != Shape::list) return RequestKind::other;
    if (!command.writes) return RequestKind::read;
    if (!command.bits || request.points != 1) return RequestKind::write;
    const auto value = request.items.empty() ? request.values.front() : request.items.front().value;
    return value != 0 ? RequestKind::force_on : RequestKind::force_off;
  }

  std::string command(const Frame& frame) const override {
    if (!frame.whole) return {};
    Bytes digits;
    append_mc(digits, McCode::ascii, request_of(frame.bytes, settings_.code).command.number, 1);
    return std::string(as_text(digits));
  }

  Ruling execute(const Frame& frame, Plc& plc) const override {
    if (!frame.whole) return {.verdict = Verdict::silent, .why = "no frame"};
    const auto request = request_of(frame.bytes, settings_.code);
    const auto& command = request.command;
    const auto refused = [&](std::uint16_t code) -> Ruling {
      return {.verdict = Verdict::nak,
              .reply = refusal(frame, code),
              .why = "end code " + to_hex(Bytes{static_cast<std::uint8_t>(code)})};
    };
    if (command.shape == Shape::none) return refused(kNoCommand);
    if (request.pc != settings_.route.pc) {
      if (!settings_.refuses_foreign)
        return {.verdict = Verdict::silent, .why = "another PC number"};
      return refused(kPcNumber);
    }
    const auto& memory = plc.memory();
    const Access access(request, settings_.cpu.holes, memory);
    if (const auto code = access.objection(); code != 0) return refused(code);
    if (command.writes && !settings_.cpu.write_in_run && plc.running()) return refused(kWriteInRun);

    Ruling ruling{.verdict = Verdict::ack, .points = request.points};
    append_mc(ruling.reply, settings_.code, command.number | kAnswer, 1);
    append_mc(ruling.reply, settings_.code, 0, 1);
    Bytes data;
    if (command.shape == Shape::row) {
      ruling.device = device_name(*request.head.device);
      ruling.count = access.devices();
    } else if (command.shape == Shape::list) {
      ruling.device = device_name(*request.items.front().device);
    }
    if (command.writes) {
      ruling.values = write(request, plc);
      if (ruling.count == 0) ruling.count = static_cast<unsigned>(ruling.values.size());
    } else if (command.shape == Shape::row) {
      data = data_of(request, memory, settings_.code);
    } else if (command.number == 0x15) {
      const bool small = memory.model().name == "FX3G";
      append_mc(data, settings_.code, small ? kModelFx3g : kModelFx3u, 1);
      append_mc(data, settings_.code, 0, 1);
    } else if (command.shape == Shape::loopback) {
      append_mc(data, settings_.code, request.points, 1);
      data.insert(data.end(), request.text.begin(), request.text.end());
    } else {
      plc.set_running(command.number == 0x13);
    }
    if (!data.empty()) ruling.verdict = Verdict::data;
    ruling.reply.insert(ruling.reply.end(), data.begin(), data.end());
    return ruling;
  }

  Bytes refusal(const Frame& frame, std::optional<std::uint16_t> code) const override {
    auto end_code = code.value_or(kUsualRefusal);
    std::uint16_t abnormal = kAbnormalPc;
    if (end_code > 0xFF) {
      abnormal = end_code & 0xFFU;
      end_code = static_cast<std::uint16_t>(end_code >> 8U);
    }
    Bytes reply;
    const auto number = request_of(frame.bytes, settings_.code).command.number;
    append_mc(reply, settings_.code, number | kAnswer, 1);
    append_mc(reply, settings_.code, end_code, 1);
    if (end_code == kPcNumber) {
      append_mc(reply, settings_.code, abnormal, 1);
      append_mc(reply, settings_.code, 0, 1);
    }
    return reply;
  }

  void spoil(Bytes& reply, Flaw flaw) const override {
    const auto code = settings_.code;
    const std::size_t unit = code == McCode::ascii ? 2 : 1;
    const auto put_byte = [&](std::size_t at, std::uint32_t value) {
      Bytes field;
      append_mc(field, code, value, 1);
      std::ranges::copy(field, reply.begin() + static_cast<std::ptrdiff_t>(at * unit));
    };
    switch (flaw) {
      case Flaw::longer:
        append_mc(reply, code, 0x1234, 2);
        break;
      case Flaw::shorter:
        reply.resize(reply.size() - std::min(2 * unit, reply.size() - 2 * unit));
        break;
      case Flaw::end_code:
        put_byte(1, kNoCommand);
        break;
      case Flaw::header: {
        McReader in(reply, code);
        put_byte(0, in.number(1) ^ 1U);
        break;
      }
      default:
        break;  // no sum, sender, serial number or length
    }
  }

 private:
  McSettings settings_;
};

}  // namespace

std::unique_ptr<Personality> make_mc_one_e(McSettings settings) {
  return std::make_unique<McOneE>(std::move(settings));
}

}  // namespace fxsim
