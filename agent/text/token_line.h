// A line of http.token_file: "NAME TOKEN" or "TOKEN".
#pragma once

#include <sstream>
#include <string>
#include <utility>

namespace fxagent {

struct TokenLine {
  std::string name{};   ///< may be empty
  std::string token{};  ///< empty: the line has none
  /// It has more words, and so no token: a name with a space would make one of them the token.
  bool is_too_long = false;
};

/// A line that begins with # is a comment. So is a third word that does, with what follows.
inline TokenLine token_line(const std::string& line) {
  std::istringstream words(line);
  TokenLine out;
  std::string more;
  words >> out.name >> out.token >> more;
  if (out.name.starts_with('#')) return {};
  if (!more.empty() && !more.starts_with('#')) return {{}, {}, true};
  if (out.token.empty()) std::swap(out.name, out.token);
  return out;
}

}  // namespace fxagent
