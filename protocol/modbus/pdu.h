// Modbus requests and answers without their frame: function code and data.
// Source: MODBUS Application Protocol Specification V1.1b3, chapters 4, 6 and 7.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

#include "protocol/codec.h"
#include "protocol/value/bytes.h"
#include "protocol/value/result.h"

namespace fxagent::modbus {

/// The four tables. Coils and discrete inputs count in bits, registers are 16 bits wide. Each table
/// has the numbers 0 to 65535.
enum class Space : std::uint16_t { coil, discrete_input, input_register, holding_register };
constexpr std::uint16_t id(Space space) { return static_cast<std::uint16_t>(space); }

inline constexpr std::uint32_t kNumbers = 65536;
inline constexpr std::uint32_t kMaxReadRegisters = 125;
inline constexpr std::uint32_t kMaxReadBits = 2000;
inline constexpr std::uint32_t kMaxWriteRegisters = 123;
inline constexpr std::uint32_t kMaxWriteBits = 1968;
/// Set in the function code of an exception.
inline constexpr std::uint8_t kException = 0x80;

enum class Function : std::uint8_t {
  read_coils = 1,
  read_discrete_inputs = 2,
  read_holding_registers = 3,
  read_input_registers = 4,
  write_coil = 5,
  write_register = 6,
  write_coils = 15,
  write_registers = 16,
  mask_write = 22,
  read_write = 23,
  device_identification = 43,
};
constexpr std::uint8_t code(Function function) { return static_cast<std::uint8_t>(function); }

/// Write::way and Force::way. `first_choice` writes a single register by 06, a coil by 05 and a bit
/// of a register by 22. The others are for devices that lack those functions.
enum class WriteWay : std::uint8_t { first_choice, several, read_modify_write };
constexpr std::uint8_t id(WriteWay way) { return static_cast<std::uint8_t>(way); }

/// Returns the bits of one coil or register.
std::uint32_t width_of(Space space);
/// Returns "co", "di", "ir", "hr".
std::string_view letters_of(Space space);

/// Returns the PDU of a request. Errors: bad_request (outside the limits of its function),
/// unsupported (Modbus has no such request).
Result<Bytes> encode_pdu(const Request& request);

/// Returns the length of the answer's PDU if it is not an exception: for an identification the
/// largest, because the device decides.
std::size_t reply_length(const Request& request);
/// Returns the length of an answer's PDU from its first bytes. nullopt if there are too few, or if
/// answers of this function do not contain their length.
std::optional<std::size_t> answer_length(ByteView pdu);
/// Decodes the whole PDU of an answer to `request`: its image or acknowledgement. nullopt if it
/// answers another function or place, as a late answer does. Error: bad_frame if it cannot be an
/// answer to any request.
Decoded decode_pdu(const Request& request, ByteView pdu);

/// An exception and its meaning for a read and for any other request.
struct Exception {
  std::string_view text;  ///< "illegal data address"; empty: not in the specification
  RefusalMeaning for_read = RefusalMeaning::final;
  RefusalMeaning otherwise = RefusalMeaning::unclear;
};
const Exception& exception_coded(int device_code);

}  // namespace fxagent::modbus
