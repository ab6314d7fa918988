#include "agent/cli/report/json_page.h"

#include <nlohmann/json.hpp>

namespace fxagent {
namespace {

using Json = nlohmann::ordered_json;

std::string line_of(const Json& value) {
  return value.dump(-1, ' ', false, Json::error_handler_t::replace);
}

std::string written(const Json& value, std::size_t indent) {
  constexpr std::size_t kLine = 120;
  const std::string line = line_of(value);
  if (!value.is_structured() || value.empty() || indent + line.size() <= kLine) return line;
  const std::string pad(indent + 2, ' ');
  std::string out(1, value.is_object() ? '{' : '[');
  for (const auto& [key, part] : value.items()) {
    out += (out.size() > 1 ? ",\n" : "\n") + pad;
    if (value.is_object()) out += line_of(key) + ": ";
    out += written(part, indent + 2);
  }
  return out + "\n" + std::string(indent, ' ') + (value.is_object() ? "}" : "]");
}

}  // namespace

std::string json_page(const Json& value) { return written(value, 0) + "\n"; }

}  // namespace fxagent
