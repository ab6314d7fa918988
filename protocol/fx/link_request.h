// Requests of the computer link: the ways to read, and the frames that carry reads, writes and
// commands. Only for the files of this codec.
// Source: FX Communication User's Manual JY992D69901 rev. E, chapters 7 and 8.
#pragma once

#include <cstdint>
#include <vector>

#include "protocol/codec.h"
#include "protocol/fx/device.h"

namespace fxagent::fx {

/// Settings of D8120 and D8121 of the PLC, from the computer's side.
struct LinkSettings {
  Model model = Model::unknown;
  std::uint32_t station = 0;     ///< 0 to 15
  bool ends_with_cr_lf = false;  ///< control procedure format 4; format 1 has no terminator
  bool sum_check = true;
  std::uint32_t wait_tens = 0;   ///< 0 to 15, times 10 ms: wait of the PLC before it answers
  bool acknowledge_data = true;  ///< answer data with ACK, as the manual requires
  /// Bytes of device memory in one frame; 128 bytes are the 64 words of the manual.
  std::uint32_t max_block_bytes = 128;

  /// Characters of the sum and of the terminator of a frame.
  std::uint32_t sum_chars() const { return sum_check ? 2U : 0U; }
  std::uint32_t terminator_chars() const { return ends_with_cr_lf ? 2U : 0U; }
};

namespace link {

inline constexpr std::uint32_t kPc = 0xFF;  ///< PLC number of every FX

/// Read::way of the two units: BR returns one character for each bit, WR and QR four for each word.
inline constexpr std::uint8_t kBitWay = 0;
inline constexpr std::uint8_t kWordWay = 1;

/// Return AddressSpace::read_ways() and AddressSpace::max_write_bits().
std::vector<ReadWay> read_ways(const LinkSettings& settings, std::uint16_t space);
std::uint32_t max_write_bits(const LinkSettings& settings, std::uint16_t space);

/// Returns the frame of any request. Errors: as Codec::encode().
Result<Bytes> encode(const LinkSettings& settings, const Request& request);
/// Returns the characters of that frame. 0 if encode() fails, except for a read.
std::uint32_t request_chars(const LinkSettings& settings, const Request& request);

/// Returns the frame that acknowledges data: ACK, station, PLC number [CR LF].
Bytes acknowledge(const LinkSettings& settings);

}  // namespace link

}  // namespace fxagent::fx
