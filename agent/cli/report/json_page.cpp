#include "agent/cli/report/json_page.h"

#include <nlohmann/json.hpp>

#include "agent/text/json.h"

namespace fxagent {
namespace {

using Json = nlohmann::ordered_json;

std::string written(const Json& value, std::size_t indent) {
  constexpr std::size_t kLine = 120;
  const std::string line = dumped(value);
  if (!value.is_structured() || value.empty() || indent + line.size() <= kLine) return line;
  const std::string pad(indent + 2, ' ');
  std::string out(1, value.is_object() ? '{' : '[');
  for (const auto& [key, part] : value.items()) {
    out += (out.size() > 1 ? ",\n" : "\n") + pad;
    if (value.is_object()) out += dumped(Json(key)) + ": ";
    out += written(part, indent + 2);
  }
  return out + "\n" + std::string(indent, ' ') + (value.is_object() ? "}" : "]");
}

}  // namespace

std::string json_page(const Json& value) { return written(value, 0) + "\n"; }

}  // namespace fxagent
