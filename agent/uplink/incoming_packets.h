// Follows the MQTT packets of one connection through the reads by which Paho takes them in, and
// keeps off it what would fill its memory. Paho makes a list of all properties of a packet, with
// two blocks of memory for each, and copies the list twice: 16 MiB of user properties would take
// more than a gigabyte. Pure.
#pragma once

#include <cstddef>
#include <cstdint>

namespace fxagent {

/// Bytes of the longest packet that is read. Told to the broker on MQTT 5. A command is 64 KiB at
/// most, and one that is far too large must still be answered.
inline constexpr std::uint32_t kMaxPacketIn = 16 << 20;
/// Bytes that the properties of a message may take, and any other packet than a message. Room for
/// the longest response topic and correlation data, and for more than a payload's limit behind
/// them.
inline constexpr std::uint32_t kMaxPropertiesIn = 192 << 10;

class IncomingPackets final {
 public:
  /// The bytes that the packet may have which the next read asks for. 0: none, since a message
  /// comes before CONNACK.
  std::size_t most() const noexcept;

  /// `got` of the `asked` bytes were read to `at`, and Paho has not seen them yet. A message with
  /// QoS 2, which nobody may send us, becomes one with QoS 1: Paho keeps the others until the
  /// broker releases them. Where properties are too many, only those that the agent looks at stay.
  /// The rest counts as the beginning of the payload, after a NUL: no JSON, and longer than
  /// kMaxMessageBytes.
  void take(unsigned char* at, std::size_t asked, std::size_t got) noexcept;

 private:
  enum class Next : std::uint8_t { head, length, body };

  bool is_message() const noexcept { return head_ >> 4 == 3; }
  void take_length(unsigned char digit) noexcept;
  void end_packet(unsigned char* body) noexcept;

  Next next_ = Next::head;
  unsigned char head_ = 0;
  std::size_t size_ = 0;  ///< of the packet behind its length
  unsigned shift_ = 0;
  bool welcomed_ = false;        ///< CONNACK has come
  bool has_properties_ = false;  ///< MQTT 5: its CONNACK is longer
};

}  // namespace fxagent
