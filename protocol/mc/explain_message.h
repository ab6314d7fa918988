// Messages of 3E, 4E, 3C and 4C in words; for the codec's own files.
#pragma once

#include "protocol/codec.h"
#include "protocol/mc/dialect.h"

namespace fxagent::mc {

/// Fills in what a request says: command, subcommand and data. What is wrong with it is in
/// `out.error`, and `out.ok` is true where nothing is.
void explain_request(Model model, Code code, ByteView message, Explanation& out);

/// The data of an answer, whose request is not known: as words, or as they are.
void explain_data(Code code, ByteView data, Explanation& out);

/// An end code that is no 0.
void explain_refusal(Model model, std::uint16_t end_code, Explanation& out);

/// "1F", as many digits as asked for.
std::string hex_text(std::uint32_t value, int digits);
/// Notes the first thing that is wrong.
void note_fault(Explanation& out, std::string error);

}  // namespace fxagent::mc
