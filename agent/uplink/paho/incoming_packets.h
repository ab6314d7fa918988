// Follows the MQTT packets of one connection through Paho's reads, and keeps away from Paho what
// would fill its memory. Paho makes a list of all properties of a packet, with two blocks of memory
// for each, and copies the list twice: 16 MiB of user properties would take more than 1 GB. Pure.
#pragma once

#include <cstddef>
#include <cstdint>

namespace fxagent {

/// Longest packet that is read, in bytes; on MQTT 5 the broker is informed of it. A command has at
/// most 64 KiB, but a far larger one must still be answered.
inline constexpr std::uint32_t kMaxPacketIn = 16 << 20;
/// Limit in bytes of a message's properties, and of any packet other than a message. Has room for
/// the longest response topic and correlation data, and for about a payload's limit in addition.
inline constexpr std::uint32_t kMaxPropertiesIn = 192 << 10;

class IncomingPackets final {
 public:
  /// Returns the most bytes of the packet that is read next. 0: a message came before CONNACK.
  std::size_t most() const noexcept;

  /// Processes `got` of the `asked` bytes, read to `at`, before Paho sees them. Changes a message
  /// with QoS 2, which no broker may send us, to QoS 1: Paho would keep it until the broker
  /// releases it. If the properties exceed kMaxPropertiesIn, keeps only those that the agent uses.
  /// The rest becomes the beginning of the payload, after a NUL: not JSON, and as a rule longer
  /// than kMaxMessageBytes.
  void take(unsigned char* at, std::size_t asked, std::size_t got) noexcept;

 private:
  enum class Next : std::uint8_t { head, length, body };

  bool is_message() const noexcept { return head_ >> 4 == 3; }
  void take_length(unsigned char digit) noexcept;
  void end_packet(unsigned char* body) noexcept;

  Next next_ = Next::head;
  unsigned char head_ = 0;
  std::size_t size_ = 0;  ///< remaining length of the packet
  unsigned shift_ = 0;
  bool welcomed_ = false;        ///< CONNACK has arrived
  bool has_properties_ = false;  ///< MQTT 5, detected by its longer CONNACK
};

}  // namespace fxagent
