#include "tests/fleet/packets.h"

#include <stdexcept>

namespace fxfleet {
namespace {

constexpr char kQos1Retained = 0x28;  // will flags of CONNECT

void put_u16(std::string& out, std::size_t value) {
  out += static_cast<char>(value >> 8 & 0xFF);
  out += static_cast<char>(value & 0xFF);
}

void put_text(std::string& out, std::string_view text) {
  put_u16(out, text.size());
  out += text;
}

/// Puts the first byte, the length and the body.
void put_packet(std::string& out, int first, std::string_view body) {
  out += static_cast<char>(first);
  std::size_t left = body.size();
  do {
    const std::size_t digit = left % 128;
    left /= 128;
    out += static_cast<char>(left > 0 ? digit | 128U : digit);
  } while (left > 0);
  out += body;
}

/// Reads fields from the front of a packet's body.
class Fields final {
 public:
  explicit Fields(std::string_view bytes) : bytes_(bytes) {}
  bool empty() const { return bytes_.empty(); }
  std::string_view rest() const { return bytes_; }

  std::uint8_t u8() { return static_cast<std::uint8_t>(take(1)[0]); }
  std::uint16_t u16() {
    const std::string_view two = take(2);
    return static_cast<std::uint16_t>(static_cast<std::uint8_t>(two[0]) << 8 |
                                      static_cast<std::uint8_t>(two[1]));
  }
  std::size_t variable() {
    std::size_t value = 0;
    for (int shift = 0; shift < 28; shift += 7) {
      const std::uint8_t digit = u8();
      value |= static_cast<std::size_t>(digit & 127) << shift;
      if (digit < 128) return value;
    }
    throw std::runtime_error("a length of more than four bytes");
  }
  std::string_view take(std::size_t count) {
    if (count > bytes_.size()) throw std::runtime_error("a packet that is too short");
    const std::string_view taken = bytes_.substr(0, count);
    bytes_.remove_prefix(count);
    return taken;
  }

 private:
  std::string_view bytes_;
};

/// Returns the Receive Maximum of a CONNACK's properties.
std::uint16_t receive_maximum(Fields properties) {
  while (!properties.empty()) {
    switch (properties.u8()) {
      case 0x21:  // Receive Maximum
        return properties.u16();
      case 0x11:  // Session Expiry Interval
      case 0x27:  // Maximum Packet Size
        properties.take(4);
        break;
      case 0x22:  // Topic Alias Maximum
      case 0x13:  // Server Keep Alive
        properties.take(2);
        break;
      case 0x24:  // Maximum QoS
      case 0x25:  // Retain Available
      case 0x28:  // Wildcard Subscription Available
      case 0x29:  // Subscription Identifier Available
      case 0x2A:  // Shared Subscription Available
        properties.take(1);
        break;
      case 0x12:  // Assigned Client Identifier
      case 0x15:  // Authentication Method
      case 0x16:  // Authentication Data
      case 0x1A:  // Response Information
      case 0x1C:  // Server Reference
      case 0x1F:  // Reason String
        properties.take(properties.u16());
        break;
      case 0x26:  // User Property
        properties.take(properties.u16());
        properties.take(properties.u16());
        break;
      default:
        throw std::runtime_error("an unknown property of a CONNACK");
    }
  }
  return 65535;
}

Packet read_body(std::uint8_t first, Fields body, Mqtt version) {
  Packet packet;
  packet.type = static_cast<PacketType>(first >> 4);
  switch (packet.type) {
    case PacketType::connack:
      body.u8();  // Session Present
      packet.code = body.u8();
      if (version == Mqtt::v3 && packet.code != 0) packet.code |= 0x80;
      if (version == Mqtt::v5)
        packet.receive_maximum = receive_maximum(Fields(body.take(body.variable())));
      break;
    case PacketType::publish:
      packet.topic = body.take(body.u16());
      if ((first & 0x06) != 0) packet.id = body.u16();
      if (version == Mqtt::v5) body.take(body.variable());
      packet.payload = body.rest();
      break;
    case PacketType::puback:
      packet.id = body.u16();
      if (!body.empty()) packet.code = body.u8();
      break;
    case PacketType::suback:
      packet.id = body.u16();
      if (version == Mqtt::v5) body.take(body.variable());
      packet.code = body.u8();
      break;
    case PacketType::pingresp:
    case PacketType::disconnect:
      break;
    default:
      throw std::runtime_error("a packet that a broker does not send to a client like this");
  }
  return packet;
}

}  // namespace

void put_connect(std::string& out, Mqtt version, const Connect& connect) {
  std::string body;
  put_text(body, "MQTT");
  body += static_cast<char>(version);
  body += static_cast<char>((connect.clean ? 0x02 : 0) |
                            (connect.will_topic.empty() ? 0 : 0x04 | kQos1Retained));
  put_u16(body, connect.keep_alive_s);
  if (version == Mqtt::v5) {
    // Session Expiry Interval of an hour, and Receive Maximum 20.
    const std::string expiry = connect.clean ? std::string() : std::string("\x11\0\0\x0E\x10", 5);
    const std::string properties = expiry + std::string("\x21\0\x14", 3);
    body += static_cast<char>(properties.size());
    body += properties;
  }
  put_text(body, connect.client_id);
  if (!connect.will_topic.empty()) {
    if (version == Mqtt::v5) body += '\0';
    put_text(body, connect.will_topic);
    put_text(body, connect.will);
  }
  put_packet(out, 0x10, body);
}

void put_subscribe(std::string& out, Mqtt version, std::uint16_t id, std::string_view filter,
                   bool no_local) {
  std::string body;
  put_u16(body, id);
  if (version == Mqtt::v5) body += '\0';
  put_text(body, filter);
  // QoS 1; on 5 also Retain As Published and, if asked for, No Local.
  body += static_cast<char>(version == Mqtt::v5 ? 0x01 | 0x08 | (no_local ? 0x04 : 0) : 0x01);
  put_packet(out, 0x82, body);
}

void put_publish(std::string& out, Mqtt version, std::uint16_t id, const Publish& publish) {
  std::string body;
  body.reserve(publish.topic.size() + publish.payload.size() + 8);
  put_text(body, publish.topic);
  if (publish.qos > 0) put_u16(body, id);
  if (version == Mqtt::v5) body += '\0';
  body += publish.payload;
  put_packet(out, 0x30 | publish.qos << 1 | (publish.retain ? 1 : 0), body);
}

void put_puback(std::string& out, std::uint16_t id) {
  std::string body;
  put_u16(body, id);
  put_packet(out, 0x40, body);
}

void put_pingreq(std::string& out) { put_packet(out, 0xC0, {}); }

void put_disconnect(std::string& out) { put_packet(out, 0xE0, {}); }

std::optional<Packet> take_packet(std::string_view& bytes, Mqtt version) {
  std::size_t length = 0;
  std::size_t at = 1;
  for (int shift = 0;; shift += 7, ++at) {
    if (at >= bytes.size()) return std::nullopt;
    if (shift == 28) throw std::runtime_error("a length of more than four bytes");
    const auto digit = static_cast<std::uint8_t>(bytes[at]);
    length |= static_cast<std::size_t>(digit & 127) << shift;
    if (digit < 128) break;
  }
  if (bytes.size() < at + 1 + length) return std::nullopt;
  const Packet packet =
      read_body(static_cast<std::uint8_t>(bytes[0]), Fields(bytes.substr(at + 1, length)), version);
  bytes.remove_prefix(at + 1 + length);
  return packet;
}

}  // namespace fxfleet
