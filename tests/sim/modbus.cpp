#include "tests/sim/modbus.h"

#include <algorithm>
#include <array>

namespace fxsim {
namespace {

constexpr std::uint8_t kIllegalFunction = 1;
constexpr std::uint8_t kIllegalAddress = 2;
constexpr std::uint8_t kIllegalValue = 3;
constexpr std::uint8_t kDeviceFailure = 4;
constexpr std::uint8_t kTargetSilent = 0x0B;
constexpr std::uint8_t kExceptionFlag = 0x80;

constexpr std::uint8_t kWriteCoil = 0x05;
constexpr std::uint8_t kWriteRegister = 0x06;
constexpr std::uint8_t kWriteCoils = 0x0F;
constexpr std::uint8_t kWriteRegisters = 0x10;
constexpr std::uint8_t kMaskRegister = 0x16;
constexpr std::uint8_t kReadWriteRegisters = 0x17;
constexpr std::array<std::uint8_t, 4> kIdentify{0x2B, 0x0E, 0x01, 0x00};  // 6.21: the basic objects

constexpr unsigned kMaxBitsRead = 2000;
constexpr unsigned kMaxBitsWritten = 1968;
constexpr unsigned kMaxRegistersWritten = 123;
constexpr unsigned kMaxRegistersWrittenAndRead = 121;
constexpr unsigned kCoilOn = 0xFF00;

struct Function {
  std::uint8_t code;
  RequestKind kind;
  Kind table;
};
constexpr auto kFunctions = std::to_array<Function>({
    {0x01, RequestKind::read, Kind::coil},
    {0x02, RequestKind::read, Kind::discrete_input},
    {0x03, RequestKind::read, Kind::holding_register},
    {0x04, RequestKind::read, Kind::input_register},
    {kWriteCoil, RequestKind::write, Kind::coil},
    {kWriteRegister, RequestKind::write, Kind::holding_register},
    {kWriteCoils, RequestKind::write, Kind::coil},
    {kWriteRegisters, RequestKind::write, Kind::holding_register},
    {kMaskRegister, RequestKind::write, Kind::holding_register},
    {kReadWriteRegisters, RequestKind::write, Kind::holding_register},
});

const Function* find_function(std::uint8_t code) {
  const auto found = std::ranges::find(kFunctions, code, &Function::code);
  return found == kFunctions.end() ? nullptr : &*found;
}

void append_number(Bytes& out, std::uint32_t number) {
  out.push_back(static_cast<std::uint8_t>(number >> 8U));
  out.push_back(static_cast<std::uint8_t>(number));
}

Bytes exception(std::uint8_t function, std::uint8_t code) {
  return {static_cast<std::uint8_t>(function | kExceptionFlag), code};
}

/// Builds the reply to a read: function, byte count and values.
Bytes read_reply(std::uint8_t function, Device first, unsigned count, const DeviceMemory& memory) {
  Bytes pdu{function};
  if (width(first.kind) == 1) {
    const auto bytes = (count + 7) / 8;
    pdu.push_back(static_cast<std::uint8_t>(bytes));
    pdu.resize(2 + bytes);
    for (unsigned i = 0; i < count; ++i)
      if (memory.get({first.kind, first.number + i}) != 0)
        pdu[2 + i / 8] = static_cast<std::uint8_t>(pdu[2 + i / 8] | 1U << (i % 8));
    return pdu;
  }
  pdu.reserve(2 + count * 2);
  pdu.push_back(static_cast<std::uint8_t>(count * 2));
  for (unsigned i = 0; i < count; ++i)
    append_number(pdu, memory.get({first.kind, first.number + i}));
  return pdu;
}

/// Builds the reply to kIdentify: these objects, and no more follow.
Bytes identity_reply(const std::vector<std::string>& objects) {
  Bytes pdu{0x2B, 0x0E, 0x01, 0x01, 0x00, 0x00, static_cast<std::uint8_t>(objects.size())};
  for (std::size_t i = 0; i < objects.size(); ++i) {
    pdu.push_back(static_cast<std::uint8_t>(i));
    pdu.push_back(static_cast<std::uint8_t>(objects[i].size()));
    pdu.insert(pdu.end(), objects[i].begin(), objects[i].end());
  }
  return pdu;
}

/// Decodes the values of a write of several registers or coils.
std::vector<std::uint32_t> values_of(Kind kind, unsigned count, ByteView data) {
  std::vector<std::uint32_t> values;
  for (unsigned i = 0; i < count; ++i)
    values.push_back(width(kind) == 1 ? (unsigned{data[i / 8]} >> (i % 8)) & 1U
                                      : big_endian_at(data, i * 2U));
  return values;
}

class Modbus final : public Personality {
 public:
  Modbus(Protocol protocol, ModbusSettings settings)
      : protocol_(protocol), settings_(std::move(settings)) {}

  Protocol protocol() const override { return protocol_; }
  std::unique_ptr<Framer> make_framer() const override { return make_modbus_framer(protocol_); }
  bool hears(const Frame& frame) const override {
    const auto unit = unwrap_modbus(protocol_, frame.bytes).unit;
    return unit == settings_.unit || is_broadcast(unit);
  }

  RequestKind kind(const Frame& frame) const override {
    if (!frame.whole) return RequestKind::malformed;
    const auto pdu = unwrap_modbus(protocol_, frame.bytes).pdu;
    const auto* function = find_function(pdu.front());
    if (function == nullptr) return RequestKind::other;
    const auto force = [](bool on) { return on ? RequestKind::force_on : RequestKind::force_off; };
    if (function->code == kWriteCoil && pdu.size() == 5)
      return force(big_endian_at(pdu, 3) == kCoilOn);
    if (function->code == kWriteCoils && pdu.size() == 7 && big_endian_at(pdu, 3) == 1)
      return force((pdu[6] & 1U) != 0);
    return function->kind;
  }

  Ruling execute(const Frame& frame, Plc& plc) const override {
    if (!frame.whole) return {.verdict = Verdict::silent, .why = "no frame"};
    const auto request = unwrap_modbus(protocol_, frame.bytes);
    const auto code = request.pdu.front();
    if (!settings_.identity.empty() && !is_broadcast(request.unit) &&
        std::ranges::equal(request.pdu, kIdentify))
      return {.verdict = Verdict::data,
              .reply = wrap_modbus(protocol_, {request.unit, identity_reply(settings_.identity)},
                                   frame.bytes)};
    const auto wrong = objection(request.pdu);
    if (is_broadcast(request.unit)) {
      if (wrong != 0 || find_function(code)->kind == RequestKind::read)
        return {.verdict = Verdict::silent, .why = "no order for all units"};
      auto ruling = carry_out(request.pdu, plc);
      ruling.reply.clear();
      return ruling;
    }
    Ruling ruling;
    if (wrong != 0) {
      ruling = {.verdict = Verdict::nak,
                .reply = exception(code, wrong),
                .why = "exception " + std::to_string(wrong)};
    } else {
      ruling = carry_out(request.pdu, plc);
    }
    ruling.reply = wrap_modbus(protocol_, {request.unit, std::move(ruling.reply)}, frame.bytes);
    return ruling;
  }

  Bytes refusal(const Frame& frame, std::optional<std::uint16_t> code) const override {
    const auto request = unwrap_modbus(protocol_, frame.bytes);
    if (is_broadcast(request.unit)) return {};
    return wrap_modbus(
        protocol_,
        {request.unit,
         exception(request.pdu.front(), static_cast<std::uint8_t>(code.value_or(kDeviceFailure)))},
        frame.bytes);
  }

  void spoil(Bytes& reply, Flaw flaw) const override { spoil_modbus(protocol_, reply, flaw); }
  Bytes nobody_there(const Frame& frame) const override { return refusal(frame, kTargetSilent); }

 private:
  /// On a serial line unit 0 is the broadcast address. On TCP it is an ordinary unit.
  bool is_broadcast(std::uint8_t unit) const {
    return unit == 0 && protocol_ != Protocol::modbus_tcp;
  }

  /// Returns the exception for the request, 0 for none. Checks function, then quantity and value,
  /// then address.
  std::uint8_t objection(ByteView pdu) const {
    const auto* function = find_function(pdu[0]);
    if (function == nullptr ||
        std::ranges::find(settings_.missing_functions, pdu[0]) != settings_.missing_functions.end())
      return kIllegalFunction;
    const auto table = function->table;
    const bool bits = width(table) == 1;
    if (pdu.size() < 5) return kIllegalValue;
    const auto first = big_endian_at(pdu, 1);
    const auto count = big_endian_at(pdu, 3);  // or a value or a mask

    // True if exactly `quantity` values follow their byte count at `at`.
    const auto carries = [pdu, bits](std::size_t at, unsigned quantity) {
      const auto bytes = bits ? (quantity + 7) / 8 : quantity * 2;
      return pdu.size() == at + 1 + bytes && pdu[at] == bytes;
    };
    const auto too_many_read = [this, bits](unsigned quantity) -> std::uint8_t {
      if (quantity == 0 || quantity > (bits ? kMaxBitsRead : 125U)) return kIllegalValue;
      return !bits && quantity > settings_.max_read ? settings_.max_read_code : std::uint8_t{0};
    };
    switch (function->code) {
      case kWriteCoil:
        if (pdu.size() != 5 || (count != kCoilOn && count != 0)) return kIllegalValue;
        return span_objection(table, first, 1);
      case kWriteRegister:
        return pdu.size() == 5 ? span_objection(table, first, 1) : kIllegalValue;
      case kWriteCoils:
      case kWriteRegisters:
        if (count == 0 || count > (bits ? kMaxBitsWritten : kMaxRegistersWritten) ||
            pdu.size() < 6 || !carries(5, count))
          return kIllegalValue;
        return span_objection(table, first, count);
      case kMaskRegister:
        return pdu.size() == 7 ? span_objection(table, first, 1) : kIllegalValue;
      case kReadWriteRegisters: {
        if (pdu.size() < 10) return kIllegalValue;
        const auto written = big_endian_at(pdu, 7);
        if (written == 0 || written > kMaxRegistersWrittenAndRead || !carries(9, written))
          return kIllegalValue;
        if (const auto wrong = too_many_read(count); wrong != 0) return wrong;
        if (const auto wrong = span_objection(table, big_endian_at(pdu, 5), written); wrong != 0)
          return wrong;
        return span_objection(table, first, count);
      }
      default:
        if (pdu.size() != 5) return kIllegalValue;
        if (const auto wrong = too_many_read(count); wrong != 0) return wrong;
        return span_objection(table, first, count);
    }
  }

  std::uint8_t span_objection(Kind kind, std::size_t first, std::size_t count) const {
    if (first + count > 0x10000) return kIllegalAddress;
    const bool hits_hole = std::ranges::any_of(settings_.holes, [&](const auto& hole) {
      return hole.kind == kind && first <= hole.range.last && first + count > hole.range.first;
    });
    return hits_hole ? kIllegalAddress : std::uint8_t{0};
  }

  /// Carries out a request. Precondition: objection() returned 0. The reply is a PDU.
  Ruling carry_out(ByteView pdu, Plc& plc) const {
    const auto& function = *find_function(pdu[0]);
    const auto& memory = plc.memory();
    Device first{function.table, big_endian_at(pdu, 1)};
    const auto count = big_endian_at(pdu, 3);
    const bool reads = function.kind == RequestKind::read;

    Ruling ruling{.verdict = reads ? Verdict::data : Verdict::ack};
    ruling.reply.assign(pdu.begin(), pdu.begin() + 5);  // the reply to most writes
    switch (function.code) {
      case kWriteCoil:
        ruling.values = {count == kCoilOn ? 1U : 0U};
        break;
      case kWriteRegister:
        ruling.values = {count};
        break;
      case kWriteCoils:
      case kWriteRegisters:
        ruling.values = values_of(first.kind, count, pdu.subspan(6));
        break;
      case kMaskRegister: {
        const auto keep = count;
        ruling.values = {(memory.get(first) & keep) | (big_endian_at(pdu, 5) & ~keep & 0xFFFFU)};
        ruling.reply.assign(pdu.begin(), pdu.end());
        break;
      }
      case kReadWriteRegisters:
        first.number = big_endian_at(pdu, 5);
        ruling.values = values_of(first.kind, big_endian_at(pdu, 7), pdu.subspan(10));
        break;
      default:
        break;
    }
    for (unsigned i = 0; i < ruling.values.size(); ++i)
      plc.write({first.kind, first.number + i}, ruling.values[i]);
    if (reads || function.code == kReadWriteRegisters)  // function 23 writes first
      ruling.reply =
          read_reply(function.code, {function.table, big_endian_at(pdu, 1)}, count, memory);
    ruling.device = device_name(first);
    ruling.count = reads ? count : static_cast<unsigned>(ruling.values.size());
    return ruling;
  }

  Protocol protocol_;
  ModbusSettings settings_;
};

}  // namespace

std::unique_ptr<Personality> make_modbus(Protocol protocol, ModbusSettings settings) {
  return std::make_unique<Modbus>(protocol, std::move(settings));
}

}  // namespace fxsim
