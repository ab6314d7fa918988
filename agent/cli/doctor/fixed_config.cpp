#include "agent/cli/doctor/fixed_config.h"

#include <nlohmann/json.hpp>

namespace fxagent {
namespace {

using Json = nlohmann::ordered_json;

Json parsed(const std::string& config) { return Json::parse(config, nullptr, true, true); }

std::optional<std::size_t> index_of(const Json& list, const std::string& name) {
  for (std::size_t i = 0; i < list.size(); ++i)
    if (list[i].value("name", "") == name) return i;
  return std::nullopt;
}

std::optional<std::string> pointer_in(const Json& config, const KeyChange& change) {
  if (!config.contains(change.list)) return std::nullopt;
  const Json& list = config[change.list];
  const auto entry = index_of(list, change.name);
  if (!entry) return std::nullopt;
  std::string pointer = "/" + change.list + "/" + std::to_string(*entry);
  if (!change.tag.empty()) {
    if (!list[*entry].contains("tags")) return std::nullopt;
    const auto tag = index_of(list[*entry]["tags"], change.tag);
    if (!tag) return std::nullopt;
    pointer += "/tags/" + std::to_string(*tag);
  }
  return pointer + "/" + change.key;
}

}  // namespace

std::string json_string(const std::string& text) {
  return Json(text).dump(-1, ' ', false, Json::error_handler_t::replace);
}

std::optional<std::string> pointer_of(const std::string& config, const KeyChange& change) {
  return pointer_in(parsed(config), change);
}

std::string fixed_config(const std::string& config, const std::vector<KeyChange>& changes) {
  Json fixed = parsed(config);
  for (const KeyChange& change : changes)
    if (const auto pointer = pointer_in(fixed, change))
      fixed[Json::json_pointer(*pointer)] = Json::parse(change.value);
  return fixed.dump(2) + "\n";
}

}  // namespace fxagent
