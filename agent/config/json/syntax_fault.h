// Finds common mistakes in a JSON text at the place of the mistake: a comment, a missing or extra
// comma, missing quotes. A parser names the unexpected character instead, often on the next line.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

#include "agent/config/json/tree.h"

namespace fxagent {

struct SyntaxFault {
  std::size_t at = 0;  ///< byte of the text
  std::string text;    ///< the fault and its cure; never quotes the text, which may hold secrets
};

/// Returns the first such fault up to `read`, the byte that the parser rejected; nullopt if there
/// is none. Linear in the size of the text. Throws only if memory runs out.
std::optional<SyntaxFault> syntax_fault(std::string_view text, std::size_t read, Comments comments);

}  // namespace fxagent
