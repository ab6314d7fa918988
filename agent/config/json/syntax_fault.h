// Names common mistakes in a JSON text at the place of the mistake: a missing or extra comma,
// missing quotes, a bracket that is not closed. A parser names the character that it did not
// expect, often on the next line.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "agent/config/json/tree.h"

namespace fxagent {

/// Part of a text that a parser accepted before it rejected a token.
struct AcceptedText {
  std::size_t end = 0;              ///< byte after the last key, value or bracket; 0: none
  bool is_key = false;              ///< a key ends there
  std::vector<std::uint32_t> open;  ///< bytes of the brackets that are open there
};

struct SyntaxFault {
  std::size_t at = 0;  ///< byte of the text
  std::string text;    ///< the fault and its cure; never quotes the text, which may hold secrets
  std::optional<std::size_t> unclosed{};  ///< byte of the bracket that lacks its end
};

/// Returns the first byte from `at` on that is neither blank nor part of an allowed comment.
std::size_t next_token(std::string_view text, std::size_t at, Comments comments);

/// Returns the mistake behind a rejected token. `read` is the last byte that the parser read. If
/// the mistake is none of those known here, returns `words`, the parser's own, for that byte.
SyntaxFault syntax_fault(std::string_view text, const AcceptedText& accepted, std::size_t read,
                         Comments comments, std::string words);

}  // namespace fxagent
