// Requests and answers of 3E, 4E, 3C and 4C without their frame: command, subcommand and data, in
// binary or ASCII code.
// Source: SH-080008, chapters 8 to 11 (scattered places: 8.3 and 8.4); protocol/README.md has the
// layout.
#pragma once

#include <cstdint>
#include <string>

#include "protocol/codec.h"
#include "protocol/mc/dialect.h"

namespace fxagent::mc {

enum class Command : std::uint16_t {
  type_name = 0x0101,
  read = 0x0401,
  random_read = 0x0403,
  block_read = 0x0406,
  remote_run = 0x1001,
  remote_stop = 0x1002,
  write = 0x1401,
  random_write = 0x1402,
};
constexpr std::uint16_t id(Command command) { return static_cast<std::uint16_t>(command); }

/// Returns command, subcommand and data of a request. Errors: bad_request (outside the limits),
/// unsupported (not possible with this protocol, model or code).
Result<Bytes> encode_message(const Dialect& dialect, const Request& request);

/// Returns the length on the wire of the data in a successful answer to `request`. encode_message()
/// must accept `request`.
std::size_t answer_size(const Dialect& dialect, const Request& request);
/// Returns the image in these data, which must have that length. Error: bad_frame if they are not
/// digits or not bits.
Result<Bytes> decode_answer(const Dialect& dialect, const Request& request, ByteView data);

/// Bytes of the type name in the image of Control::identify. Two more hold the model code.
inline constexpr std::size_t kTypeName = 16;

// End codes, in end_code.cpp: their text, with the setting to check, and their meaning for the next
// polls and commands of the device.

/// Returns "end code C056: beyond the last device". If a setting helps, the text names it as the
/// tool of that series does.
std::string end_code_text(std::uint16_t code, Series series);
/// Returns the meaning for a read or for any other request. `runs_or_stops`: such a request is
/// never sent twice, whatever the reason.
RefusalMeaning meaning_of_end_code(std::uint16_t code, bool reads, bool runs_or_stops);
/// True if a PLC refuses every request with this code, for a password or a setting of its port.
bool refuses_everything(std::uint16_t code);
/// True if the PLC lacks the command or its subcommand.
bool is_unknown_command(std::uint16_t code);

// Explanations, in explain_message.cpp.

/// Fills in command, subcommand and data of a request. Sets `out.ok` to true, or to false with the
/// reason in `out.error`.
void explain_request(Model model, Code code, ByteView message, Explanation& out);

/// True if explain_request() knows the command.
bool is_known_command(std::uint32_t command);

/// Explains the data of an answer whose request is unknown, as words or unchanged.
void explain_data(Code code, ByteView data, Explanation& out);

/// Explains an end code other than 0.
void explain_refusal(Model model, std::uint16_t end_code, Explanation& out);

}  // namespace fxagent::mc
