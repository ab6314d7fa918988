#include "agent/commands/parse/parse.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "agent/config/json/tree.h"
#include "agent/config/suggestions.h"
#include "agent/text/json.h"
#include "agent/text/json_writer.h"

namespace fxagent {
namespace {

using Json = nlohmann::json;

constexpr std::size_t kMaxCommandBytes = 65536;
constexpr std::size_t kMaxIdLength = 64;
constexpr std::size_t kMaxPlaceLength = 128;  ///< of tag and address; a longer one cannot be right
constexpr std::size_t kMaxDepth = 3;  ///< root object, `targets`, one target, an array value in it
constexpr const char* kTooDeep = "nested too deeply";

constexpr std::size_t kMaxQuoted = 64;
constexpr std::size_t kMaxOpKept = 64;       ///< characters of an op that the result repeats
constexpr std::int64_t kMostElements = 125;  ///< of a read by address
constexpr std::int64_t kMostCharacters = 2 * kMostElements;

/// Returns the first 64 bytes of a sender's text in quotes, for a detail.
std::string in_quotes(std::string_view foreign) {
  return "'" + std::string(foreign.substr(0, kMaxQuoted)) + "'";
}

/// Returns the first fault that the JSON library accepts, a duplicate key or deep nesting; empty if
/// there is none. The node is inside of `depth` objects and arrays.
std::string fault_in(const ConfigNode& node, std::size_t depth) {
  const bool is_object = node.kind == ConfigNode::Kind::object;
  if ((is_object || node.kind == ConfigNode::Kind::array) && depth > kMaxDepth) return kTooDeep;
  std::set<std::string_view> keys;
  for (const ConfigNode& child : node.children) {
    if (is_object && !keys.insert(child.key).second)
      return "key " + in_quotes(child.key) + " occurs twice";
    if (std::string fault = fault_in(child, depth + 1); !fault.empty()) return fault;
  }
  return {};
}

std::string not_a_scalar(const Json& json, const std::string& what) {
  if (json.is_null()) return what + " is null, as NaN is in JSON";
  return what + " must be a number, a boolean or a string";
}

/// Returns the value under `key`, or nullopt with the reason in `fault`.
std::optional<Value> value_of(const Json& json, const std::string& key, std::string& fault) {
  if (!json.is_array()) {
    auto scalar = scalar_of(json);
    if (scalar) return Value(*std::move(scalar));
    fault = not_a_scalar(json, key) + (json.is_null() ? "" : ", or an array of them");
    return std::nullopt;
  }
  Scalars items;
  for (const Json& element : json) {
    auto scalar = scalar_of(element);
    if (!scalar) {
      fault = not_a_scalar(element, "element " + std::to_string(items.size() + 1) + " of " + key);
      return std::nullopt;
    }
    items.push_back(*std::move(scalar));
  }
  return Value::array(std::move(items));
}

const Json* find(const Json& object, std::string_view key) {
  const auto found = object.find(key);
  return found == object.end() ? nullptr : &*found;
}

/// Returns the value of a key. Null counts as absent, since templates fill in every key.
const Json* given(const Json& object, std::string_view key) {
  const Json* value = find(object, key);
  return value == nullptr || value->is_null() ? nullptr : value;
}

// ---- keys ---------------------------------------------------------------------------------------

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

std::string unknown(std::string_view name) {
  return "unknown key " + in_quotes(name) + did_you_mean(name, names_in(kKeys));
}

/// Checks keys that refine an address: they need one, and `count` and `length` depend on its type.
void check_address_keys(const Json& target, Faults& faults) {
  const auto misplaced = [&](const char* key, const char* where) {
    if (given(target, key) != nullptr)
      faults.add(Reason::bad_json, "key " + in_quotes(key) + " is only for " + where);
  };
  if (given(target, "address") == nullptr) {
    if (given(target, "tag") == nullptr) return;  // not a target; read_place() reports it
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
  const bool needs_one_target = key.stands == Stands::beside_one_target;
  if (object == Object::target && key.stands != Stands::in_target)
    return std::string("is not a key of a target") +
           (needs_one_target ? ": it needs a command without targets" : "");
  if (!op) return "";
  if ((key.ops & kGroups[static_cast<std::size_t>(*op)]) == 0)
    return "is not for op " + std::string(to_string(*op));
  if (object == Object::command_with_targets && key.stands != Stands::in_command)
    return std::string("cannot be used together with targets: ") +
           (needs_one_target ? "send a command with one tag or address" : "set it in each target");
  return "";
}

void check_object(const Json& json, Object object, std::optional<Op> op, Faults& faults) {
  for (const auto& [name, value] : json.items()) {
    const auto* key = std::ranges::find(kKeys, name, &Key::name);
    if (key == kKeys.end()) {
      faults.add(Reason::bad_json, unknown(name));
    } else if (!value.is_null() || name == "expect" || name == "value") {
      const std::string why = why_misplaced(*key, object, op);
      if (!why.empty()) faults.add(Reason::bad_json, "key " + in_quotes(name) + " " + why);
    }
  }
  if (op) check_address_keys(json, faults);
}

/// Adds bad_json for each key of `command`, a JSON object, that does not go with `op`, with the
/// target or with `targets`. Without an op, only for unknown keys and keys that no target may have.
/// Null counts as absent, except for `expect` and `value`: a lost condition (NaN becomes null) must
/// not become an unconditional write.
void check_keys(const Json& command, std::optional<Op> op, Faults& faults) {
  const Json* targets = given(command, "targets");
  check_object(command, targets != nullptr ? Object::command_with_targets : Object::command, op,
               faults);
  if (targets == nullptr || !targets->is_array()) return;
  for (std::size_t i = 0; i < targets->size(); ++i) {
    Faults own;
    if ((*targets)[i].is_object()) check_object((*targets)[i], Object::target, op, own);
    if (const auto& first = own.first())
      faults.add(first->reason, "target " + std::to_string(i + 1) + ": " + first->detail);
  }
}

// ---- values -------------------------------------------------------------------------------------

/// Returns an integer that a double holds exactly. A sender may write 2.0 or 1.79e12.
std::optional<std::int64_t> exact_integer(const Json& json) {
  if (!json.is_number()) return std::nullopt;
  const auto number = json.get<double>();
  if (std::abs(number) > static_cast<double>(json::kMaxExactInteger) ||
      number != std::floor(number))
    return std::nullopt;
  const auto integer = json.get<std::int64_t>();
  return std::abs(integer) > json::kMaxExactInteger ? std::nullopt : std::optional(integer);
}

void read_id(const Json& object, Command& command, Faults& faults) {
  const Json* id = given(object, "id");
  if (id == nullptr) return faults.add(Reason::missing_id, "no id");
  if (const auto number = exact_integer(*id)) {
    command.id = std::to_string(*number);
    command.id_is_number = true;
    return;
  }
  const auto* text = id->get_ptr<const std::string*>();
  const bool fits =
      text != nullptr && !text->empty() && text->size() <= kMaxIdLength &&
      std::all_of(text->begin(), text->end(), [](char c) { return c >= ' ' && c <= '~'; });
  if (!fits)
    return faults.add(Reason::missing_id,
                      "id must be a string of 1 to 64 printable ASCII characters, or an integer "
                      "from -2^53 to 2^53");
  command.id = *text;
}

void read_op(const Json& object, Command& command, std::string_view ops, Faults& faults) {
  const std::string words(ops);
  const Json* op = given(object, "op");
  const auto* text = op == nullptr ? nullptr : op->get_ptr<const std::string*>();
  if (text == nullptr) {
    return faults.add(Reason::bad_op, std::string(op == nullptr ? "no op" : "op must be a string") +
                                          "; one of " + words);
  }
  command.op_text = text->substr(0, kMaxOpKept);
  command.op = op_from(*text);
  if (command.op) return;
  std::string with_underscores = *text;
  std::ranges::replace(with_underscores, '-', '_');
  faults.add(Reason::bad_op,
             "op " + in_quotes(*text) + " is not one of " + words +
                 (words.find(with_underscores) != words.npos ? " (with _, not -)" : ""));
}

void read_type(const Json& type, CommandTarget& target, Faults& faults) {
  const auto* word = type.get_ptr<const std::string*>();
  const auto known = word == nullptr
                         ? Result<DataType>(fail(ErrorCode::bad_request, "type must be a string"))
                         : data_type_from(*word);
  if (known)
    target.type = *known;
  else
    faults.add(Reason::bad_value, known.error().text);
}

/// Reads the number of elements or characters that a read by address asks for.
void read_extent(const Json& object, CommandTarget& target, Faults& faults) {
  for (const auto& [key, most] :
       {std::pair("count", kMostElements), std::pair("length", kMostCharacters)}) {
    const Json* extent = given(object, key);
    if (extent == nullptr) continue;
    const auto number = exact_integer(*extent);
    if (number && *number >= 1 && *number <= most)
      target.count = static_cast<std::uint16_t>(*number);
    else
      faults.add(Reason::bad_value,
                 std::string(key) + " must be an integer from 1 to " + std::to_string(most));
  }
}

void read_place(const Json& object, CommandTarget& target, Faults& faults) {
  const Json* tag = given(object, "tag");
  const Json* address = given(object, "address");
  if (tag != nullptr && address != nullptr)
    return faults.add(Reason::bad_address, "tag and address cannot be used together");
  if (tag == nullptr && address == nullptr)
    return faults.add(Reason::unknown_tag, "neither tag nor address");
  const auto* name = (tag != nullptr ? tag : address)->get_ptr<const std::string*>();
  if (name == nullptr || name->empty())
    return faults.add(tag != nullptr ? Reason::unknown_tag : Reason::bad_address,
                      std::string(tag != nullptr ? "tag" : "address") +
                          " must be a string with at least one character");
  (tag != nullptr ? target.tag : target.address) = name->substr(0, kMaxPlaceLength);
  if (address == nullptr) return;
  if (const Json* type = given(object, "type")) read_type(*type, target, faults);
  read_extent(object, target, faults);
}

/// `object` is the command itself, or one of its `targets`.
CommandTarget read_target(const Json& object, Faults& of_command) {
  CommandTarget target;
  Faults faults;
  if (object.is_object()) {
    read_place(object, target, faults);
    std::string fault;
    if (const Json* value = find(object, "value")) target.value = value_of(*value, "value", fault);
    if (!fault.empty()) faults.add(Reason::bad_value, fault);
  } else {
    faults.add(Reason::bad_address, "each target must be an object");
  }
  target.fault = faults.first();
  of_command.add(target.fault);
  return target;
}

void read_targets(const Json& object, Command& command, Faults& faults) {
  const Json* targets = given(object, "targets");
  if (targets == nullptr) {
    if (command.op != Op::run && command.op != Op::stop)
      command.targets.push_back(read_target(object, faults));
    return;
  }
  command.is_list = true;
  if (!targets->is_array() || targets->empty())
    return faults.add(Reason::bad_address, "targets must be an array of at least one target");
  if (targets->size() > kMostTargets)
    return faults.add(Reason::too_large, std::to_string(targets->size()) +
                                             " targets; a command has at most " +
                                             std::to_string(kMostTargets));
  for (const Json& entry : *targets) command.targets.push_back(read_target(entry, faults));
}

/// Returns the first `id` of the command itself in a text that may end anywhere; nullopt if there
/// is none, or if it is an object or array. Keeps nothing else of the text.
std::optional<Json> id_in(std::string_view text) {
  using Event = Json::parse_event_t;
  std::optional<Json> id;
  bool was_seen = false;
  bool is_next = false;
  const auto look = [&](int depth, Event event, const Json& parsed) {
    if (is_next && event == Event::value) id = parsed;
    is_next = event == Event::key && depth == 1 && !was_seen && parsed == "id";
    was_seen = was_seen || is_next;
    return depth == 0 && event == Event::object_start;
  };
  [[maybe_unused]] const Json rest =
      Json::parse(text.begin(), text.end(), look, /*allow_exceptions=*/false);
  return id;
}

/// Reads a key that must be `true` or `false` if present.
std::optional<bool> read_flag(const Json* flag, const char* key, Faults& faults) {
  if (flag == nullptr) return std::nullopt;
  if (flag->is_boolean()) return flag->get<bool>();
  faults.add(Reason::bad_value, std::string(key) + " must be true or false" +
                                    (flag->is_string() ? ", without quotes" : ""));
  return std::nullopt;
}

void read_conditions(const Json& object, Command& command, Faults& faults) {
  if (const Json* expires = given(object, "expires")) {
    if (const auto at = exact_integer(*expires); at >= 0)
      command.expires_ms = at;
    else
      faults.add(Reason::bad_value,
                 std::string("expires must be milliseconds UTC, a whole number") +
                     (expires->is_string() ? ", without quotes" : ""));
  }
  if (const Json* expect = find(object, "expect")) {
    std::string fault;
    command.expect = value_of(*expect, "expect", fault);
    if (!fault.empty()) faults.add(Reason::bad_value, fault);
  }
  command.verify = read_flag(given(object, "verify"), "verify", faults);
  command.dry_run = read_flag(given(object, "dry_run"), "dry_run", faults).value_or(false);
  if (const Json* by = given(object, "by")) {
    if (by->is_string())
      command.by = by->get<std::string>();
    else
      faults.add(Reason::bad_value, "by must be a string");
  }
}

/// Reads the text as one object. Adds what is wrong with its form; what of it can be read is in
/// `command`. nullopt: there is no object.
std::optional<Json> read_object(std::string_view payload, Command& command, Faults& faults) {
  if (payload.size() > kMaxCommandBytes) {
    // Too many properties come as a part of the payload: uplink/paho/incoming_packets.h.
    faults.add(Reason::too_large,
               "more than 65536 bytes, or more than 192 KiB of MQTT 5 properties");
    Faults of_id;
    if (const auto id = id_in(payload)) read_id({{"id", *id}}, command, of_id);
    return std::nullopt;
  }
  const auto tree = ConfigTree::parse(payload, ConfigTree::Folding::none, kAnyTree);
  Json json = parsed_json(payload);
  if (json.is_discarded() || !json.is_object()) {
    const std::string why = tree ? "not JSON" : tree.error().text;
    faults.add(Reason::bad_json, json.is_discarded() ? why : "a command is a JSON object");
    return std::nullopt;
  }
  if (!tree)  // The library takes a NUL for the end of the text, and has no limit of depth.
    faults.add(Reason::bad_json,
               payload.find('\0') == std::string_view::npos
                   ? kTooDeep
                   : "a NUL byte is not JSON: send the text without its terminating zero");
  if (const auto number = vanishing_number(payload); !number.empty())
    faults.add(Reason::bad_json, "the number " + std::string(number.substr(0, kMaxQuoted)) +
                                     " is too close to 0 for a float64 and would be read as 0");
  if (std::string fault = tree ? fault_in(tree->root(), 0) : std::string(); !fault.empty())
    faults.add(Reason::bad_json, std::move(fault));
  if (json.contains("status"))
    faults.add(Reason::bad_json, "key 'status' belongs to a result: this is not a command");
  return json;
}

}  // namespace

Command parse_command(std::string_view payload, std::string_view ops) {
  Command command;
  Faults faults;
  if (const auto json = read_object(payload, command, faults)) {
    read_id(*json, command, faults);
    read_op(*json, command, ops, faults);
    check_keys(*json, command.op, faults);
    read_targets(*json, command, faults);
    read_conditions(*json, command, faults);
  }
  command.refusal = faults.first();
  return command;
}

LinkCommand parse_link_command(std::string_view payload) {
  LinkCommand out;
  Command& command = out.command;
  Faults faults;
  if (const auto json = read_object(payload, command, faults)) {
    if (given(*json, "id") != nullptr) read_id(*json, command, faults);
    read_conditions(*json, command, faults);
    const Json* op = given(*json, "op");
    if (op != nullptr && op->is_string())
      command.op_text = op->get<std::string>().substr(0, kMaxOpKept);
    const bool yields = command.op_text == "yield";
    const bool is_known = yields || command.op_text == "resume";
    if (!is_known)
      faults.add(Reason::bad_op,
                 "this topic takes yield and resume; a device has a topic of its own");
    for (const auto& [key, value] : json->items()) {
      const bool fits = key == "id" || key == "op" || key == "by" || key == "expires" ||
                        (key == "minutes" && yields);
      if (!fits && !value.is_null())
        faults.add(Reason::bad_json,
                   "key " + in_quotes(key) + " does not go with " +
                       (is_known ? command.op_text
                                 : "yield and resume, which this topic takes; a device has a topic "
                                   "of its own"));
    }
    const Json* minutes = given(*json, "minutes");
    const auto number = minutes == nullptr ? std::nullopt : exact_integer(*minutes);
    if (number && *number >= 1 && *number <= kLongestYield.count())
      out.time = std::chrono::minutes(*number);
    else if (minutes != nullptr)
      faults.add(
          minutes->is_number() ? Reason::out_of_range : Reason::bad_value,
          "minutes must be a whole number from 1 to " + std::to_string(kLongestYield.count()));
    if (!yields) out.time = std::chrono::minutes(0);
  }
  command.refusal = faults.first();
  return out;
}

}  // namespace fxagent
