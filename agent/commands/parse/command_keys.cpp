#include "agent/commands/parse/command_keys.h"

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>

#include "agent/config/suggestions.h"

namespace fxagent {
namespace {

using Json = nlohmann::json;

constexpr std::size_t kMaxQuoted = 64;

// Groups of ops with the same keys.
constexpr unsigned kWrite = 1;
constexpr unsigned kForce = 2;
constexpr unsigned kRead = 4;
constexpr unsigned kRunStop = 8;
constexpr unsigned kAny = kWrite | kForce | kRead | kRunStop;

enum class Stands { in_command, beside_one_target, in_target };

struct Key {
  std::string_view name;
  unsigned ops;
  Stands stands;
};
constexpr std::array<Key, 14> kKeys{{
    {"id", kAny, Stands::in_command},
    {"op", kAny, Stands::in_command},
    {"expires", kAny, Stands::in_command},
    {"by", kAny, Stands::in_command},
    {"dry_run", kAny, Stands::in_command},
    {"targets", kWrite | kForce, Stands::in_command},
    {"verify", kWrite | kForce, Stands::in_command},
    {"expect", kWrite | kForce, Stands::beside_one_target},
    {"count", kRead, Stands::beside_one_target},
    {"length", kRead, Stands::beside_one_target},
    {"tag", kWrite | kForce | kRead, Stands::in_target},
    {"address", kWrite | kForce | kRead, Stands::in_target},
    {"type", kWrite | kForce | kRead, Stands::in_target},
    {"value", kWrite, Stands::in_target},
}};

// By Op.
constexpr std::array kGroups{kWrite, kForce, kForce, kRead, kRunStop, kRunStop};
static_assert(kGroups.size() == static_cast<std::size_t>(Op::stop) + 1);

const Key* known(std::string_view name) {
  const auto* key = std::ranges::find(kKeys, name, &Key::name);
  return key == kKeys.end() ? nullptr : key;
}

bool is_absent(std::string_view key, const Json& value) {
  return value.is_null() && key != "expect" && key != "value";
}

bool has(const Json& object, const char* key) {
  const auto found = object.find(key);
  return found != object.end() && !is_absent(key, *found);
}

std::string unknown(std::string_view name) {
  std::array<std::string_view, kKeys.size()> names;
  std::ranges::transform(kKeys, names.begin(), &Key::name);
  return "unknown key " + in_quotes(name) + did_you_mean(name, names);
}

/// Checks keys that refine an address: they need one, and `count` and `length` depend on its type.
void check_address_keys(const Json& target, Faults& faults) {
  const auto misplaced = [&](const char* key, const char* where) {
    if (has(target, key))
      faults.add(Reason::bad_json, "key " + in_quotes(key) + " is only for " + where);
  };
  if (!has(target, "address")) {
    if (!has(target, "tag")) return;  // not a target; read_place() reports it
    for (const char* key : {"type", "count", "length"}) misplaced(key, "an address");
    return;
  }
  const auto type = target.find("type");
  if (type != target.end() && *type == "string")
    misplaced("count", "types other than string; a string has a length");
  else
    misplaced("length", "type string");
}

enum class Object { command, command_with_targets, target };

/// Returns why a known key must not stand there; empty if it may.
std::string why_misplaced(const Key& key, Object object, std::optional<Op> op) {
  if (object == Object::target && key.stands != Stands::in_target)
    return "is not a key of a target";
  if (!op) return "";
  if ((key.ops & kGroups[static_cast<std::size_t>(*op)]) == 0)
    return "is not for op " + std::string(to_string(*op));
  if (object == Object::command_with_targets && key.stands != Stands::in_command)
    return "cannot be used together with targets: set it in each target";
  return "";
}

void check_object(const Json& json, Object object, std::optional<Op> op, Faults& faults) {
  for (const auto& item : json.items()) {
    const Key* key = known(item.key());
    if (key == nullptr) {
      faults.add(Reason::bad_json, unknown(item.key()));
    } else if (!is_absent(item.key(), item.value())) {
      const std::string why = why_misplaced(*key, object, op);
      if (!why.empty()) faults.add(Reason::bad_json, "key " + in_quotes(item.key()) + " " + why);
    }
  }
  if (op) check_address_keys(json, faults);
}

}  // namespace

std::string in_quotes(std::string_view foreign) {
  return "'" + std::string(foreign.substr(0, kMaxQuoted)) + "'";
}

void check_keys(const Json& command, std::optional<Op> op, Faults& faults) {
  const bool is_list = has(command, "targets");
  check_object(command, is_list ? Object::command_with_targets : Object::command, op, faults);
  if (!is_list || !command["targets"].is_array()) return;
  for (const Json& entry : command["targets"])
    if (entry.is_object()) check_object(entry, Object::target, op, faults);
}

}  // namespace fxagent
