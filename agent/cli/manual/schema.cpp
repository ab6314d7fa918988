#include "agent/cli/manual/schema.h"

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <set>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "agent/cli/manual/command_pages.h"
#include "agent/cli/report/layout.h"
#include "agent/config/keys.h"
#include "agent/config/suggestions.h"
#include "agent/text/json.h"
#include "protocol/catalog.h"

namespace fxagent {
namespace {

using Json = nlohmann::ordered_json;
using Type = ConfigKey::Type;

template <class... F>
struct Overload : F... {
  using F::operator()...;
};

/// Rules that the key table does not have, by the path of a key or of an object. A string with
/// `${…}` in it passes everywhere: the variable may hold anything.
struct Rules {
  std::string_view path;
  std::string_view json;
};
constexpr std::string_view kListen =
    R"({"pattern": "^(([0-9.]+|localhost|\\[[0-9A-Fa-f:.]+\\]):[0-9]{1,5}|unix:/[^\\u0000-\\u001f\\u007f]{1,106}|.*\\$\\{.*)$"})";
// A host of digits and dots is an IPv4 address.
constexpr std::string_view kHost =
    R"({"pattern": "^(?![0-9.]+$)[^ /@\\[\\]\\u0000-\\u001f\\u007f]+$|^((25[0-5]|2[0-4][0-9]|1[0-9]{2}|[1-9]?[0-9])(\\.(?!$)|$)){4}$|\\$\\{"})";
constexpr std::array kRules{
    Rules{"agent.root",
          R"({"maxLength": 256,
              "pattern": "^(?!/)(?!.*//)(?!.*/$)(?!\\$[^{])[^+#\\u0000-\\u001f\\u007f]+$"})"},
    Rules{"agent.remote_allow",
          R"({"items": {"type": "string",
              "pattern": "^(links|devices|mqtt\\.servers|commands\\.allow_run_stop|commands\\.allow: *[A-Za-z0-9].*|.*\\$\\{.*)$"}})"},
    Rules{"mqtt.servers",
          R"({"minItems": 1, "items": {"type": "string",
              "pattern": "^(mqtts?://([A-Za-z0-9._-]+|\\[[0-9A-Fa-f:.]+\\])(:[0-9]{1,5})?|.*\\$\\{.*)$"}})"},
    Rules{"mqtt",
          R"({"if": {"required": ["version"], "properties": {"version": {"const": "3.1.1"}}},
              "then": {"dependencies": {"password_file": ["username"], "password_env": ["username"],
                                        "password": ["username"]}},
              "dependencies": {"password": {"not": {"anyOf": [{"required": ["password_file"]},
                                                              {"required": ["password_env"]}]}}}})"},
    Rules{"mqtt.tls",
          R"({"dependencies": {"cert_file": ["key_file"], "key_file": ["cert_file"]}})"},
    Rules{"http.listen", kListen},
    Rules{"http.hosts", R"({"items": {"type": "string", "pattern": "^[^/: ]+$|\\$\\{"}})"},
    Rules{"metrics.listen", kListen},
    Rules{"links[]",
          R"({"oneOf": [{"required": ["serial"]}, {"required": ["tcp"]}, {"required": ["udp"]}],
              "dependencies": {"line_baud": ["tcp"], "data_bits": ["line_baud"],
                               "parity": ["line_baud"], "stop_bits": ["line_baud"]}})"},
    Rules{"links[].tcp.host", kHost},
    Rules{"links[].udp.host", kHost},
    Rules{"templates", R"({"propertyNames": {"pattern": "^[a-z0-9_-]{1,64}$"},
              "additionalProperties": {"allOf": [{"$ref": "#/definitions/many_devices"}],
                "not": {"anyOf": [{"required": ["template"]}, {"required": ["n"]}]}}})"},
    Rules{"devices", R"({"items": {
              "if": {"type": "object", "anyOf": [{"required": ["template"]}, {"required": ["n"]}]},
              "then": {"$ref": "#/definitions/many_devices"},
              "else": {"$ref": "#/definitions/device"}}})"},
    Rules{"devices[].n",
          R"({"anyOf": [{"type": "string",
                "pattern": "^ *[0-9]{1,9}( *(-|\\.\\.) *[0-9]{1,9})? *(, *[0-9]{1,9}( *(-|\\.\\.) *[0-9]{1,9})? *)*$|\\$\\{"},
               {"type": "array", "minItems": 1, "maxItems": 10000,
                "items": {"anyOf": [{"type": "integer"}, {"$ref": "#/definitions/name"}]}}]})"},
    Rules{"devices[].tags[]",
          R"({"allOf": [
            {"if": {"required": ["type"], "properties": {"type": {"const": "string"}}},
             "then": {"required": ["length"], "not": {"required": ["states"]}},
             "else": {"not": {"required": ["length"]}}},
            {"if": {"required": ["type"], "properties": {"type": {"enum": ["bool", "string"]}}},
             "then": {"not": {"anyOf": [{"required": ["scale"]}, {"required": ["offset"]},
                                        {"required": ["min"]}, {"required": ["max"]},
                                        {"required": ["deadband"]}]}}},
            {"if": {"required": ["type"], "properties": {"type": {"const": "bool"}}},
             "then": {"not": {"required": ["word_order"]},
                      "properties": {"states": {"properties": {"0": {}, "1": {}},
                                                "additionalProperties": false}}}}]})"},
    Rules{"devices[].tags[].scale", R"({"not": {"const": 0}})"},
    Rules{"devices[].tags[].deadband", R"({"minimum": 0})"},
    Rules{"devices[].tags[].unit", R"({"pattern": ""})"},
    Rules{"devices[].tags[].description", R"({"pattern": ""})"},
    Rules{"devices[].tags[].states",
          R"({"patternProperties": {"^(0|-?[1-9][0-9]*)$": {"type": "string", "minLength": 1}},
              "additionalProperties": false})"},
};

Json rules_of(std::string_view path) {
  const auto found = std::ranges::find(kRules, path, &Rules::path);
  return found == kRules.end() ? Json::object() : parsed_ordered_json(found->json);
}

std::string path_of(const ConfigKey& key) {
  return (key.section.empty() ? "" : std::string(key.section) + '.') + std::string(key.name);
}

std::string meaning_of(const ConfigKey& key) {
  constexpr std::string_view first = "0.1";
  return std::string(key.meaning) +
         (key.since == first ? "" : " Since " + std::string(key.since) + ".");
}

/// Returns the keys of a section as devices of `protocol` have them.
std::vector<ConfigKey> keys_of(std::string_view section, const ProtocolInfo& protocol) {
  const auto common = config_section(section);
  std::vector<ConfigKey> keys(common.begin(), common.end());
  const auto put = [&](const ConfigKey& own) {
    const auto same = std::ranges::find(keys, own.name, &ConfigKey::name);
    if (same != keys.end())
      *same = own;
    else
      keys.push_back(own);
  };
  if (section == "devices[]")
    for (const ConfigKey& own : protocol_keys(protocol)) put(own);
  if (section == "devices[].tags[]") put(word_order_key(&protocol));
  return keys;
}

/// A key of a device entry that stands for many devices.
bool makes_many(const ConfigKey& key) {
  return key.is("devices[].template") || key.is("devices[].n");
}

class SchemaMaker {
 public:
  Json make() {
    Json out{{"$schema", "http://json-schema.org/draft-07/schema#"},
             {"title", "fxagent configuration"},
             {"description",
              "For editors. `fxagent check` is the authority and also finds what a schema cannot "
              "express: addresses that the model lacks, links that do not exist, duplicate names. "
              "${NAME} in a string is taken from the environment; $${NAME} is a literal ${NAME}."}};
    definitions_ = {{"name",
                     {{"description", "1 to 64 of a-z, 0-9, _ and -. It becomes part of topics."},
                      {"type", "string"},
                      {"pattern", R"(^([a-z0-9_-]{1,64}|.*\$\{.*)$)"}}},
                    {"with_n",
                     {{"description",
                       "{n} is replaced by each value of the key `n` of the device; on its own it "
                       "is a number if the key takes one."},
                      {"type", "string"},
                      {"pattern", R"(\{n\})"}}}};
    out.update(object("", catalog().front()));
    Json branches = Json::array();
    for (const ProtocolInfo& protocol : catalog())
      branches.push_back({{"if",
                           {{"required", {"protocol"}},
                            {"properties", {{"protocol", {{"const", protocol.name}}}}}}},
                          {"then", device(protocol)}});
    definitions_["device"] = {{"type", "object"},
                              {"required", required("devices[]", catalog().front())},
                              {"properties", {{"protocol", property(protocol_key())}}},
                              {"allOf", branches}};
    definitions_["many_devices"] = many("devices[]");
    definitions_["many_devices"].erase("required");  // the template may have them
    out["definitions"] = definitions_;
    return out;
  }

 private:
  /// Returns a reference to `schema`, which stands once however many protocols have it. It is
  /// called `name`, or `name` and the protocol if others of that name differ.
  Json shared(const std::string& name, Json schema, const ProtocolInfo& protocol) {
    std::string place = name;
    for (const auto& [known, value] : definitions_.items())
      if (value == schema && known.starts_with(name)) return reference(known);
    if (definitions_.contains(place)) place += "_" + std::string(protocol.name);
    definitions_[place] = std::move(schema);
    return reference(place);
  }
  static Json reference(const std::string& place) { return {{"$ref", "#/definitions/" + place}}; }

  static Json property(const ConfigKey& key) {
    std::string meaning = meaning_of(key);
    if (const auto* rule = std::get_if<ConfigKey::Rule>(&key.fallback))
      meaning += " Default: " + std::string(rule->text) + ".";
    if (key.type == Type::path) meaning += " A relative path counts from this file's directory.";
    Json out{{"description", meaning}};
    constexpr std::array kTypes{"string",  "string", "string", "integer", "number",
                                "boolean", "string", "object", "array"};  // the order of Type
    static_assert(kTypes.size() == static_cast<std::size_t>(Type::numbers));
    // `numbers` is a string or an array: kRules.
    if (key.type != Type::numbers) out["type"] = kTypes[static_cast<std::size_t>(key.type)];
    if (key.type == Type::name) out["allOf"] = Json::array({reference("name")});
    if (key.type == Type::text || key.type == Type::path)
      out["pattern"] = R"(^[^\u0000-\u001f\u007f]+$)";
    if (key.type == Type::choice) out["enum"] = key.limits.words;
    if (key.type == Type::integer) {
      out["minimum"] = key.limits.min;
      out["maximum"] = key.limits.max;
    }
    std::visit(Overload{[](ConfigKey::None) {}, [](ConfigKey::Required) {}, [](ConfigKey::Rule) {},
                        [&](const auto& value) { out["default"] = value; }},
               key.fallback);
    out.update(rules_of(path_of(key)));
    return out;
  }

  /// Adds what names look like in the memory of the protocol's devices.
  static void describe_addresses(Json& out, const ConfigKey& key, const AddressForms& forms) {
    const auto add = [&out](std::string_view text) {
      out["description"] = out["description"].get<std::string>() + ' ' + std::string(text);
    };
    if (key.is("devices[].tags[].address")) {
      add(forms.examples);
      out["pattern"] = forms.pattern;
    } else if (key.is("devices[].tags[].type")) {
      add(forms.types);
    } else if (key.is("devices[].commands.allow")) {
      add(forms.range_examples);
      out["items"] = {{"type", "string"}, {"pattern", forms.range_pattern}};
    }
  }

  Json property(const ConfigKey& key, const ProtocolInfo& protocol) {
    Json out = property(key);
    const std::string path = path_of(key);
    if (path == "devices") return out;  // its items are definitions
    if (key.type == Type::array && !config_section(path + "[]").empty())
      out["items"] = object(path + "[]", protocol);
    else if (key.type == Type::object && !config_section(path).empty())
      out.update(object(path, protocol));
    else
      describe_addresses(out, key, protocol.address_forms);
    return out;
  }

  static Json required(std::string_view section, const ProtocolInfo& protocol) {
    Json names = Json::array();
    for (const ConfigKey& key : keys_of(section, protocol))
      if (key.is_required()) names.push_back(key.name);
    return names;
  }

  /// Returns the object with the keys of a section.
  Json object(const std::string& section, const ProtocolInfo& protocol) {
    Json out{{"type", "object"}};
    if (Json names = required(section, protocol); !names.empty()) out["required"] = names;
    out["additionalProperties"] = false;
    Json& properties = out["properties"] = Json::object();
    for (const ConfigKey& key : keys_of(section, protocol)) {
      if (makes_many(key) || key.is("devices[].protocol")) continue;
      Json own = property(key, protocol);
      if (section.starts_with("devices[]"))
        own = shared(definition_of(section, key), std::move(own), protocol);
      properties[std::string(key.name)] = std::move(own);
    }
    out.update(rules_of(section));
    return out;
  }

  /// "tags_address" for the key `address` of devices[].tags[].
  static std::string definition_of(std::string_view section, const ConfigKey& key) {
    std::string name(section.substr(section.rfind('.') + 1));  // all of it without a dot
    if (name.ends_with("[]")) name.resize(name.size() - 2);
    return name + "_" + std::string(key.name);
  }

  Json device(const ProtocolInfo& protocol) {
    Json out = object("devices[]", protocol);
    out["properties"]["protocol"] = {{"const", protocol.name}, {"description", protocol.summary}};
    out.erase("required");  // stands in the definition of all devices
    return out;
  }

  /// Returns the object with the keys that devices of any protocol have; `{n}` may stand in each.
  Json many(const std::string& section) {
    Json out{{"type", "object"}};
    if (Json names = required(section, catalog().front()); !names.empty()) out["required"] = names;
    out["additionalProperties"] = false;
    Json& properties = out["properties"] = Json::object();
    for (const ProtocolInfo& protocol : catalog())
      for (const ConfigKey& key : keys_of(section, protocol)) {
        Json& slot = properties[std::string(key.name)];
        if (slot.is_null()) slot = many_of(key);
        add_choice(slot, key, protocol);
      }
    return out;
  }

  Json many_of(const ConfigKey& key) {
    const std::string path = path_of(key);
    if (makes_many(key)) return property(key);
    if (key.is("devices[].protocol")) return property(protocol_key());
    if (!config_section(path + "[]").empty())
      return {{"type", "array"}, {"items", many(path + "[]")}};
    if (!config_section(path).empty()) return many(path);
    const Json choices{{"anyOf", Json::array({reference("with_n")})}};
    if (key.type == Type::array) return {{"type", "array"}, {"items", choices}};
    return choices;
  }

  /// Adds the key as this protocol has it, before `with_n`.
  void add_choice(Json& slot, const ConfigKey& key, const ProtocolInfo& protocol) {
    if (makes_many(key)) return;
    Json one = property(key, protocol);
    const bool is_list = slot.contains("items") && slot["items"].contains("anyOf");
    if (!is_list && !slot.contains("anyOf")) return;
    if (is_list)
      one = one["items"];
    else
      one = shared(definition_of(key.section, key), std::move(one), protocol);
    Json& choices = is_list ? slot["items"]["anyOf"] : slot["anyOf"];
    if (std::ranges::find(choices, one) == choices.end()) choices.insert(choices.end() - 1, one);
  }

  Json definitions_ = Json::object();
};

// ---- tables -------------------------------------------------------------------------------------

std::string range_of(const ConfigKey& key) {
  constexpr std::array kWords{"name",    "string", "path",   "",      "number",
                              "boolean", "",       "object", "array", "range or list"};
  static_assert(kWords.size() == static_cast<std::size_t>(Type::numbers) + 1);
  const auto& [min, max, words] = key.limits;
  if (key.type == Type::choice) return "`" + joined(words, "` `") + "`";
  if (key.type == Type::integer)
    return std::to_string(min) + (max - min == 1 ? ", " : "–") + std::to_string(max);
  return kWords[static_cast<std::size_t>(key.type)];
}

std::string default_of(const ConfigKey& key) {
  return std::visit(Overload{[](ConfigKey::None) { return std::string("none"); },
                             [](ConfigKey::Required) { return std::string("required"); },
                             [](ConfigKey::Rule rule) { return std::string(rule.text); },
                             [](bool flag) { return std::string(flag ? "true" : "false"); },
                             [](std::int64_t number) { return std::to_string(number); },
                             [](std::string_view word) { return "`" + std::string(word) + "`"; }},
                    key.fallback);
}

std::string row(const std::string& prefix, const ConfigKey& key) {
  return "| `" + prefix + std::string(key.name) + "` | " + range_of(key) + " | " + default_of(key) +
         " | " + meaning_of(key) + " |\n";
}

constexpr std::string_view kHead = "| key | type, range | default | meaning |\n|---|---|---|---|\n";

// ---- man page -----------------------------------------------------------------------------------

std::string type_of(const ConfigKey& key) {
  constexpr std::array kWords{"name",         "text", "path",   "",      "number",
                              "true | false", "",     "object", "array", "range or list"};
  static_assert(kWords.size() == static_cast<std::size_t>(Type::numbers) + 1);
  if (key.type == Type::integer)
    return std::to_string(key.limits.min) + " to " + std::to_string(key.limits.max);
  if (key.type != Type::choice) return kWords[static_cast<std::size_t>(key.type)];
  return joined(key.limits.words, " | ");
}

std::string fallback_of(const ConfigKey& key) {
  if (key.is_required()) return "required";
  if (std::holds_alternative<ConfigKey::None>(key.fallback)) return "optional";
  return "default: " + default_of(key);
}

/// Removes the backquotes of Markdown.
std::string without_backquotes(std::string_view text) {
  std::string out(text);
  std::erase(out, '`');
  return out;
}

std::string entry(const ConfigKey& key) {
  return ".TP\n\\fB" + roff(key.name) + "\\fR: " + roff(type_of(key)) + " (" +
         roff(without_backquotes(fallback_of(key))) + ")\n" +
         roff(without_backquotes(key.meaning)) + "\n";
}

}  // namespace

std::string config_schema() { return json_page(SchemaMaker().make()); }

std::string config_tables() {
  // Objects without a table of their own stand in that of their parent.
  const std::set<std::string_view> within{"mqtt.tls", "links[].serial", "links[].tcp",
                                          "links[].udp"};
  std::vector<std::string_view> sections;
  for (const ConfigKey& key : config_keys::kWritten)
    if (sections.empty() || sections.back() != key.section) sections.push_back(key.section);
  std::string out;
  for (const std::string_view section : sections) {
    if (within.contains(section)) continue;
    out += kHead;
    for (const ConfigKey& key : config_keys::kWritten) {
      if (key.section != section) continue;
      out += row("", key.is("devices[].protocol") ? protocol_key() : key);
      if (const std::string below = path_of(key); within.contains(below))
        for (const ConfigKey& inner : config_section(below))
          out += row(std::string(key.name) + ".", inner);
    }
    if (section != "devices[]") continue;
    std::string before;
    for (const ProtocolInfo& protocol : catalog()) {
      std::string table(kHead);
      for (const ConfigKey& key : protocol_keys(protocol)) table += row("", key);
      if (table != before) out += table;
      before = table;
    }
  }
  return out;
}

std::string config_page(const std::string& version) {
  std::string out = ".TH FXAGENT.JSON 5 \"\" \"" + roff("fxagent " + version) +
                    "\" \"File Formats\"\n.nh\n.SH NAME\nfxagent.json \\- config file of fxagent\n"
                    ".SH DESCRIPTION\nA JSON file in UTF\\-8. Unknown keys are errors. "
                    "\\fBfxagent check\\fR names every error with its line. "
                    "${NAME} in a string is taken from the environment.\n";
  std::string_view section = "-";
  for (const ConfigKey& key : config_keys::kWritten) {
    if (key.section != section) {
      section = key.section;
      out += ".SH \"" + (section.empty() ? std::string("TOP LEVEL") : roff(section)) + "\"\n";
    }
    out += entry(key);
  }
  for (const ProtocolInfo& protocol : catalog()) {
    out += ".SH \"" + roff("devices[] with protocol " + std::string(protocol.name)) + "\"\n";
    for (const ConfigKey& key : protocol_keys(protocol)) out += entry(key);
  }
  return out +
         ".SH FILES\n.TP\n.I /etc/fxagent/agent.json\nThe config of the service.\n.TP\n"
         ".I /usr/share/doc/fxagent/docs/config\nWiring, addresses, types and examples.\n"
         ".SH SEE ALSO\n.BR fxagent (1)\n";
}

}  // namespace fxagent
