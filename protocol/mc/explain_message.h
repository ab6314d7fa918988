// Explains messages of 3E, 4E, 3C and 4C. Only for the files of this codec.
#pragma once

#include "protocol/codec.h"
#include "protocol/mc/dialect.h"

namespace fxagent::mc {

/// Fills in command, subcommand and data of a request. Sets `out.ok` to true, or to false with the
/// reason in `out.error`.
void explain_request(Model model, Code code, ByteView message, Explanation& out);

/// Explains the data of an answer whose request is unknown, as words or unchanged.
void explain_data(Code code, ByteView data, Explanation& out);

/// Explains an end code other than 0.
void explain_refusal(Model model, std::uint16_t end_code, Explanation& out);

}  // namespace fxagent::mc
