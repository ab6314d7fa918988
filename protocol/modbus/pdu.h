// Modbus requests and answers without their frame: function code and data.
// Source: MODBUS Application Protocol Specification V1.1b3, chapters 4, 6 and 7.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "protocol/bytes.h"
#include "protocol/codec.h"
#include "protocol/result.h"

namespace fxagent::modbus {

/// The four tables. Coils and discrete inputs count in bits, registers are 16 bits wide; each has
/// numbers 0 to 65535.
enum class Space : std::uint16_t { coil, discrete_input, input_register, holding_register };
constexpr std::uint16_t id(Space space) { return static_cast<std::uint16_t>(space); }

inline constexpr std::uint32_t kNumbers = 65536;
inline constexpr std::uint32_t kMaxReadRegisters = 125;
inline constexpr std::uint32_t kMaxReadBits = 2000;
inline constexpr std::uint32_t kMaxWriteRegisters = 123;
inline constexpr std::uint32_t kMaxWriteBits = 1968;
/// Set in the function code of an answer that is an exception.
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
};
constexpr std::uint8_t code(Function function) { return static_cast<std::uint8_t>(function); }

/// Write::way and Force::way. A single register goes by 06, a coil by 05, a bit of a register by
/// 22; the others are for devices that lack those functions.
enum class WriteWay : std::uint8_t { first_choice, several, read_modify_write };
constexpr std::uint8_t id(WriteWay way) { return static_cast<std::uint8_t>(way); }

/// Bits of one coil or register.
std::uint32_t width_of(Space space);
/// "co", "di", "ir", "hr".
std::string_view letters_of(Space space);

/// The PDU of a request. bad_request: outside of the limits of its function; unsupported: Modbus
/// has no such request.
Result<Bytes> encode_pdu(const Request& request);

/// Length of the answer's PDU when it is no exception.
std::size_t reply_length(const Request& request);
/// The length that an answer's PDU has by its own first bytes; nullopt: too few of them, or a
/// function whose answers do not tell.
std::optional<std::size_t> answer_length(ByteView pdu);
/// The image or the acknowledgement in a whole PDU of an answer to `request`. nullopt: this answers
/// something else (another function or place), as a late answer does. bad_frame: it cannot be an
/// answer to anything.
Result<std::optional<Reply>> decode_pdu(const Request& request, ByteView pdu);

/// "illegal data address"; empty for a code that the specification does not know.
std::string_view exception_text(int device_code);

}  // namespace fxagent::modbus
