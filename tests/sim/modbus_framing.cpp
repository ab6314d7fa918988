#include "tests/sim/modbus.h"

#include <algorithm>
#include <array>

namespace fxsim {
namespace {

// Longer than a character at 300 baud, shorter than any master's time-out.
constexpr std::chrono::milliseconds kRtuSilence{50};
constexpr std::chrono::seconds kAsciiSilence{1};
constexpr std::size_t kMaxRtu = 256;
constexpr std::size_t kMaxAscii = 513;
constexpr std::size_t kTcpHeader = 6;  // transaction, protocol and length, two bytes each
constexpr std::size_t kMinTcpLength = 2;
constexpr std::size_t kMaxTcpLength = 254;

constexpr std::uint16_t kCrcStart = 0xFFFF;
constexpr auto kCrcTable = [] {
  std::array<std::uint16_t, 256> table{};
  for (unsigned i = 0; i < table.size(); ++i) {
    unsigned crc = i;
    for (int bit = 0; bit < 8; ++bit) crc = (crc & 1U) != 0 ? (crc >> 1U) ^ 0xA001U : crc >> 1U;
    table[i] = static_cast<std::uint16_t>(crc);
  }
  return table;
}();

std::uint16_t crc_with(std::uint16_t crc, std::uint8_t byte) {
  return static_cast<std::uint16_t>((crc >> 8U) ^ kCrcTable[(crc ^ byte) & 0xFFU]);
}

void append_crc(Bytes& bytes) {
  auto crc = kCrcStart;
  for (const auto byte : bytes) crc = crc_with(crc, byte);
  bytes.push_back(static_cast<std::uint8_t>(crc));  // low byte first
  bytes.push_back(static_cast<std::uint8_t>(crc >> 8U));
}

/// Returns the byte that makes the total sum 0.
std::uint8_t lrc_of(ByteView bytes) { return static_cast<std::uint8_t>(0x100U - sum_of(bytes)); }

/// The size of the RTU request that begins with these bytes, including unit and CRC.
struct RtuLength {
  enum class Known : std::uint8_t { not_yet, yes, by_crc } known;
  std::size_t bytes = 0;
};

RtuLength rtu_length(ByteView begun) {
  using Known = RtuLength::Known;
  if (begun.size() < 2) return {Known::not_yet};
  const auto counted = [begun](std::size_t count_at, std::size_t quantity_at,
                               bool bits) -> RtuLength {
    if (begun.size() <= count_at) return {Known::not_yet};
    const std::size_t count = begun[count_at];
    const std::size_t quantity = big_endian_at(begun, quantity_at);
    if (quantity == 0 || count != (bits ? (quantity + 7) / 8 : quantity * 2))
      return {Known::by_crc};
    return {Known::yes, count_at + 1 + count + 2};
  };
  switch (begun[1]) {
    case 0x01:
    case 0x02:
    case 0x03:
    case 0x04:
    case 0x05:
    case 0x06:
    case 0x08:
      return {Known::yes, 8};
    case 0x07:
    case 0x0B:
    case 0x0C:
    case 0x11:
      return {Known::yes, 4};
    case 0x0F:
      return counted(6, 4, true);
    case 0x10:
      return counted(6, 4, false);
    case 0x16:
      return {Known::yes, 10};
    case 0x17:
      return counted(10, 8, false);
    default:
      return {Known::by_crc};
  }
}

class RtuFramer final : public Framer {
 public:
  void take(std::uint8_t byte, TimePoint when, std::vector<Frame>& out) override {
    if (when - last_ > kRtuSilence) give_up(out);
    last_ = when;
    if (frame_.empty()) crc_ = kCrcStart;
    frame_.push_back(byte);
    crc_ = crc_with(crc_, byte);
    const bool right = crc_ == 0;  // 0 over a message followed by its CRC
    const auto length = rtu_length(frame_);
    if (length.known == RtuLength::Known::yes && frame_.size() >= length.bytes) {
      finish(right, when, out);
    } else if (length.known == RtuLength::Known::by_crc && right && frame_.size() >= 4) {
      finish(true, when, out);
    } else if (frame_.size() >= kMaxRtu) {
      finish(false, when, out);
    }
  }

 private:
  std::uint16_t crc_ = kCrcStart;
};

/// Decodes unit, PDU and LRC of ":0103...\r\n". Returns nullopt for any other line.
std::optional<Bytes> ascii_content(ByteView frame) {
  const auto text = as_text(frame);
  if (text.size() < 9 || !text.ends_with("\r\n") || text.find(' ') != std::string_view::npos)
    return std::nullopt;
  auto bytes = from_hex(text.substr(1, text.size() - 3));
  if (!bytes || bytes->size() < 3 || sum_of(*bytes) != 0) return std::nullopt;
  return bytes;
}

class AsciiFramer final : public Framer {
 public:
  void take(std::uint8_t byte, TimePoint when, std::vector<Frame>& out) override {
    if (!frame_.empty() && (when - last_ > kAsciiSilence || byte == ':')) end(out);
    last_ = when;
    if (frame_.empty() && byte != ':') {
      add_stray(byte, when, out);
      return;
    }
    frame_.push_back(byte);
    if (byte == '\n' || frame_.size() >= kMaxAscii) end(out);
  }

 private:
  void end(std::vector<Frame>& out) { finish(ascii_content(frame_).has_value(), last_, out); }
};

class TcpFramer final : public Framer {
 public:
  void take(std::uint8_t byte, TimePoint when, std::vector<Frame>& out) override {
    if (lost_) {
      add_stray(byte, when, out);
      return;
    }
    frame_.push_back(byte);
    if (frame_.size() < kTcpHeader) return;
    const std::size_t length = big_endian_at(frame_, 4);
    lost_ = length < kMinTcpLength || length > kMaxTcpLength;
    if (!lost_ && frame_.size() < kTcpHeader + length) return;
    finish(!lost_ && big_endian_at(frame_, 2) == 0, when, out);
  }
};

Bytes joined(const ModbusMessage& message) {
  Bytes bytes;
  bytes.reserve(message.pdu.size() + 3);
  bytes.push_back(message.unit);
  bytes.insert(bytes.end(), message.pdu.begin(), message.pdu.end());
  return bytes;
}

Bytes ascii_line(ByteView content) {
  Bytes line{':'};
  for (const auto byte : content) append_hex(line, byte);
  append_hex(line, lrc_of(content));
  line.insert(line.end(), {'\r', '\n'});
  return line;
}

}  // namespace

std::unique_ptr<Framer> make_modbus_framer(Protocol protocol) {
  if (protocol == Protocol::modbus_rtu) return std::make_unique<RtuFramer>();
  if (protocol == Protocol::modbus_ascii) return std::make_unique<AsciiFramer>();
  return std::make_unique<TcpFramer>();
}

ModbusMessage unwrap_modbus(Protocol protocol, ByteView frame) {
  Bytes ascii;
  auto content = frame.subspan(std::min(kTcpHeader, frame.size()));
  if (protocol == Protocol::modbus_rtu) {
    content = frame.first(frame.size() - 2);
  } else if (protocol == Protocol::modbus_ascii) {
    ascii = ascii_content(frame).value_or(Bytes{0, 0, 0});
    content = ByteView(ascii).first(ascii.size() - 1);
  }
  return {content.front(), Bytes(content.begin() + 1, content.end())};
}

Bytes wrap_modbus(Protocol protocol, const ModbusMessage& reply, ByteView request) {
  auto content = joined(reply);
  if (protocol == Protocol::modbus_ascii) return ascii_line(content);
  if (protocol == Protocol::modbus_rtu) {
    append_crc(content);
    return content;
  }
  Bytes bytes(request.begin(), request.begin() + 4);  // transaction and protocol
  bytes.reserve(kTcpHeader + content.size());
  bytes.push_back(static_cast<std::uint8_t>(content.size() >> 8U));
  bytes.push_back(static_cast<std::uint8_t>(content.size()));
  bytes.insert(bytes.end(), content.begin(), content.end());
  return bytes;
}

void spoil_modbus(Protocol protocol, Bytes& reply, Flaw flaw) {
  const bool tcp = protocol == Protocol::modbus_tcp;
  if (flaw == Flaw::sum && !tcp) {
    // The last byte of the CRC, or the last digit of the LRC.
    auto& last = reply[reply.size() - (protocol == Protocol::modbus_ascii ? 3 : 1)];
    last = static_cast<std::uint8_t>(last == '0' ? '1' : '0');
  } else if (flaw == Flaw::sender && tcp) {
    ++reply[kTcpHeader];
  } else if (flaw == Flaw::sender) {
    auto other = unwrap_modbus(protocol, reply);
    ++other.unit;
    reply = wrap_modbus(protocol, other, {});
  } else if (flaw == Flaw::transaction && tcp) {
    const auto before = big_endian_at(reply, 0) - 1;
    reply[0] = static_cast<std::uint8_t>(before >> 8U);
    reply[1] = static_cast<std::uint8_t>(before);
  } else if (flaw == Flaw::length && tcp) {
    reply[4] = reply[5] = 0xFF;
  }
}

}  // namespace fxsim
