// The MQTT packets that a player and the commander need, for 3.1.1 and 5. Shares no code with the
// agent. Source: OASIS MQTT Version 3.1.1 and MQTT Version 5.0.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace fxfleet {

enum class Mqtt : std::uint8_t { v3 = 4, v5 = 5 };

/// Types of packets: the upper half of their first byte.
enum class PacketType : std::uint8_t {
  connack = 2,
  publish = 3,
  puback = 4,
  suback = 9,
  pingresp = 13,
  disconnect = 14,
};

struct Connect {
  std::string_view client_id;
  std::uint16_t keep_alive_s = 30;
  /// Clean Session, or Clean Start with a session expiry of 0.
  bool clean = true;
  std::string_view will_topic;  ///< empty: no will
  std::string_view will;        ///< retained, QoS 1
};

struct Publish {
  std::string topic;
  std::string payload;
  int qos = 1;
  bool retain = false;
};

/// A packet as received. The views refer to the reader's buffer.
struct Packet {
  PacketType type = PacketType::connack;
  std::uint16_t id = 0;  ///< PUBACK, SUBACK, and PUBLISH with QoS 1
  int code = 0;          ///< CONNACK, PUBACK, and the first of SUBACK; 0x80 and above: refused
  std::uint16_t receive_maximum = 65535;  ///< CONNACK
  std::string_view topic;                 ///< PUBLISH
  std::string_view payload;               ///< PUBLISH
};

// Each of these appends one packet to `out`.
void put_connect(std::string& out, Mqtt version, const Connect& connect);
void put_subscribe(std::string& out, Mqtt version, std::uint16_t id, std::string_view filter,
                   bool no_local);
void put_publish(std::string& out, Mqtt version, std::uint16_t id, const Publish& publish);
void put_puback(std::string& out, std::uint16_t id);
void put_pingreq(std::string& out);
void put_disconnect(std::string& out);

/// Takes the first whole packet from `bytes`. Returns nullopt if it is not complete yet. Throws
/// std::runtime_error if the bytes are not MQTT.
std::optional<Packet> take_packet(std::string_view& bytes, Mqtt version);

}  // namespace fxfleet
