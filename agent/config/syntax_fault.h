// What people most often get wrong in a JSON text, found where they wrote it: a comment, a missing
// or a spare comma, quotes that are not there. A parser names the character that it did not expect
// instead, often on the next line.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

namespace fxagent {

struct SyntaxFault {
  std::size_t at = 0;  ///< byte of the text
  std::string text;    ///< what is wrong and what to do; never what stands in the text
};

/// The first such fault among the bytes up to `read`, the one that a parser has refused. nullopt:
/// it is none of these. Linear in `read`; never throws but for memory.
std::optional<SyntaxFault> syntax_fault(std::string_view text, std::size_t read);

}  // namespace fxagent
