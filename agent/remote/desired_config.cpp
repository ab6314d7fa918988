#include "agent/remote/desired_config.h"

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "agent/config/config_error.h"
#include "agent/config/json/tree.h"
#include "agent/config/read/findings.h"
#include "agent/config/suggestions.h"
#include "agent/text/json.h"
#include "agent/text/sha256.h"
#include "agent/text/text.h"

namespace fxagent {
namespace {

using Json = nlohmann::json;
using Kind = ConfigNode::Kind;
using std::string_view_literals::operator""sv;

constexpr std::array kKeys{"version"sv, "config"sv, "patch"sv, "by"sv};
/// Keys of `mqtt` with credentials, or with the place where they are kept.
constexpr std::array kSecrets{"username"sv,     "password"sv,           "password_file"sv,
                              "password_env"sv, "allow_plain_secret"sv, "tls"sv};
constexpr std::string_view kNeedsTheFile =
    "cannot be set remotely: change the local file and restart the agent";

// ---- the shape of the document ------------------------------------------------------------------

/// Returns the pointer without the leading `/config` or `/patch`.
std::string place_of(const ConfigNode& node) {
  std::string pointer = pointer_to(node);
  for (const auto body : {"/config/"sv, "/patch/"sv})
    if (pointer.starts_with(body)) return pointer.substr(body.size() - 1);
  return pointer;
}

void report(ErrorList& errors, const ConfigNode& at, std::string text) {
  errors.add({place_of(at), 0, std::move(text)});
}

std::string read_word(ErrorList& errors, const ConfigNode& node) {
  const bool is_word = node.kind == Kind::string && !node.text.empty() &&
                       node.text.size() <= kMaxDesiredVersion &&
                       std::ranges::none_of(node.text, is_control);
  if (is_word) return node.text;
  report(errors, node,
         "must be a string of 1 to " + std::to_string(kMaxDesiredVersion) +
             " bytes without control characters");
  return {};
}

/// Reports duplicate keys: the library that merges would silently use the last one.
void refuse_duplicates(ErrorList& errors, const ConfigNode& node) {
  std::set<std::string_view> seen;
  for (const ConfigNode& child : node.children) {
    if (node.kind == Kind::object && !seen.insert(child.key).second)
      report(errors, child, "duplicate key");
    refuse_duplicates(errors, child);
  }
}

void read_shape(ErrorList& errors, const ConfigNode& root, DesiredConfig& out) {
  if (root.kind != Kind::object) return report(errors, root, "must be an object");
  refuse_duplicates(errors, root);
  for (const ConfigNode& member : root.children)
    if (!contains(kKeys, member.key))
      report(errors, member,
             "unknown key \"" + shown(member.key) + "\"" +
                 (errors.empty() ? did_you_mean(member.key, kKeys) : ""));
  const ConfigNode* version = root.find("version");
  if (version == nullptr)
    report(errors, root, "\"version\" is missing");
  else
    out.version = read_word(errors, *version);
  if (const ConfigNode* by = root.find("by")) out.by = read_word(errors, *by);
  const ConfigNode* config = root.find("config");
  const ConfigNode* patch = root.find("patch");
  if ((config == nullptr) == (patch == nullptr))
    report(errors, root,
           config == nullptr ? "needs \"config\" or \"patch\""
                             : "has both \"config\" and \"patch\": use only one");
  for (const ConfigNode* body : {config, patch})
    if (body != nullptr && body->kind != Kind::object) report(errors, *body, "must be an object");
}

// ---- the limits of the local file, section by section -------------------------------------------

bool names_variable(std::string_view text) {
  for (std::size_t at = 0; (at = text.find("${", at)) != text.npos; ++at)
    if (at == 0 || text[at - 1] != '$') return true;
  return false;
}

/// Returns "/key", escaped.
std::string token_of(const std::string& key) { return (Json::json_pointer() / key).to_string(); }

struct Merged {
  std::string text;
  ErrorList errors;
  std::set<std::string> replaced;  ///< pointers of the texts that only stand in for a variable
};

/// Merges the document into the local file. What must not be set remotely stays as it is there.
class Merger {
 public:
  Merger(Json local, const Json& document, const RemoteLimits& limits)
      : local_(std::move(local)),
        is_patch_(document.contains("patch")),
        body_(document.at(is_patch_ ? "patch" : "config")),
        limits_(limits),
        next_(local_) {}

  Merged run() {
    put_body();
    std::set<std::string> sections;
    for (const Json* each : {&std::as_const(local_), &std::as_const(next_), &body_})
      for (const auto& [key, value] : each->items()) sections.insert(key);
    for (const std::string& section : sections) restrain(section);
    return {dumped(next_), std::move(errors_), std::move(replaced_)};
  }

 private:
  void error(const std::string& pointer, std::string text) {
    errors_.add({shown(pointer, pointer.npos), 0, std::move(text)});
  }

  void put_body() {
    if (is_patch_) return next_.merge_patch(body_);
    for (const auto& [section, value] : body_.items()) {
      // A document may set only part of `mqtt`, so merge its keys and keep the others.
      if (section == "mqtt" && value.is_object() && local_.contains(section))
        next_[section].update(value);
      else
        next_[section] = value;
    }
  }

  void restrain(const std::string& section) {
    if (section == "links") return restrain(section, section, limits_.links);
    if (section == "devices" || section == "templates")
      return restrain(section, "devices", limits_.devices);
    if (section == "mqtt") return restrain_mqtt();
    if (section == "$schema") return restore(section);
    if (!differs(next_, local_, section)) return;
    restore(section);
    const bool is_key = contains(config_section(""), section, &ConfigKey::name);
    error(token_of(section), is_key ? std::string(kNeedsTheFile) : "is not a section of a config");
  }

  void restrain(const std::string& section, std::string_view word, bool is_allowed) {
    if (is_allowed) {
      if (body_.contains(section)) refuse_variables(body_[section], "/" + section);
      return;
    }
    if (!differs(next_, local_, section)) return;
    restore(section);
    error("/" + section, not_named(word));
  }

  void restrain_mqtt() {
    if (!body_.contains("mqtt")) return;
    const Json& given = body_["mqtt"];
    if (!given.is_object()) {
      restore("mqtt");
      return error("/mqtt", "must be an object");
    }
    Json mqtt = local_.at("mqtt");
    const Json& wanted = next_.at("mqtt");
    for (const auto& [key, value] : given.items()) {
      const std::string pointer = "/mqtt" + token_of(key);
      // Reject even an unchanged secret: the answer would show whether a guess is right.
      if (contains(kSecrets, key))
        error(pointer, "cannot be set remotely, not even unchanged: remove it");
      else if (key == "servers" && limits_.servers)
        refuse_variables(value, pointer);
      else if (differs(wanted, mqtt, key))
        error(pointer,
              key == "servers"
                  ? not_named("mqtt.servers")
                  : "differs from the local file; of mqtt only servers can be set remotely");
      if (key != "servers" || !limits_.servers) continue;
      if (wanted.contains(key))
        mqtt[key] = wanted[key];
      else
        mqtt.erase(key);
    }
    next_["mqtt"] = std::move(mqtt);
  }

  void refuse_variables(const Json& value, const std::string& pointer) {
    if (value.is_string() && names_variable(value.get_ref<const std::string&>())) {
      // Replace the text, so that no error shows whether the variable exists.
      next_[Json::json_pointer(pointer)] = "";
      replaced_.insert(shown(pointer, pointer.npos));
      return error(pointer,
                   "a remote config cannot use environment variables, which may hold secrets; for "
                   "a literal ${ write $${");
    }
    if (!value.is_structured()) return;
    for (const auto& [key, inner] : value.items()) refuse_variables(inner, pointer + token_of(key));
  }

  static std::string not_named(std::string_view word) {
    return "differs from the local file, whose agent.remote_allow does not have \"" +
           std::string(word) + "\"";
  }

  static bool differs(const Json& one, const Json& other, const std::string& key) {
    if (one.contains(key) != other.contains(key)) return true;
    return one.contains(key) && one[key] != other[key];
  }

  void restore(const std::string& section) {
    if (local_.contains(section))
      next_[section] = local_[section];
    else
      next_.erase(section);
  }

  const Json local_;
  const bool is_patch_;
  const Json& body_;
  const RemoteLimits& limits_;
  Json next_;
  ErrorList errors_;
  std::set<std::string> replaced_;
};

/// Removes each " (line 1)": the lines are those of the merged text, which the sender never sees.
std::string without_lines(std::string text) {
  constexpr std::string_view begin = " (line ";
  std::size_t at = 0;
  while ((at = text.find(begin, at)) != text.npos) {
    const std::size_t end = text.find_first_not_of("0123456789", at + begin.size());
    if (end != text.npos && text[end] == ')')
      text.erase(at, end + 1 - at);
    else
      at += begin.size();
  }
  return text;
}

/// Adds the errors of the merged text, without those of `replaced`.
void add_parser_errors(ErrorList& errors, ConfigErrors found,
                       const std::set<std::string>& replaced) {
  std::set<std::string> unseen = replaced;
  std::size_t unlisted = 0;
  for (ConfigError& error : found) {
    unlisted += error.unlisted;
    const bool is_of_variable = !error.of_key && replaced.contains(error.pointer);
    if (is_of_variable) unseen.erase(error.pointer);
    if (is_of_variable || error.unlisted > 0) continue;
    error.line = 0;
    error.text = without_lines(std::move(error.text));
    errors.add(std::move(error));
  }
  // Each other replaced text has an error among the unlisted ones.
  if (unlisted > unseen.size()) errors.add(unlisted_error(unlisted - unseen.size()));
}

}  // namespace

ReadDesired read_desired(std::string_view payload) {
  ReadDesired out;
  out.desired.hash = short_hash(payload);
  if (payload.size() > kMaxDesiredBytes) {
    out.errors.push_back({"", 0, "larger than " + std::to_string(kMaxDesiredBytes >> 20) + " MiB"});
    return out;
  }
  const auto tree =
      ConfigTree::parse(payload, ConfigTree::Folding::none, {.nodes = kMaxDesiredValues});
  if (!tree) {
    out.errors.push_back({"", 0, tree.error().text});
    return out;
  }
  ErrorList errors;
  read_shape(errors, tree->root(), out.desired);
  out.errors = errors.take();
  if (out.errors.empty()) out.desired.text = payload;
  return out;
}

tl::expected<Config, ConfigErrors> effective_config(std::string_view local_text,
                                                    const Config& local,
                                                    const DesiredConfig& desired,
                                                    const ParseConfig& parse,
                                                    const std::atomic<bool>* stop) {
  Json file = parsed_json(local_text, /*ignore_comments=*/true);
  if (file.is_discarded())
    return tl::unexpected(ConfigErrors{{"", 0, "the local file is not JSON any more"}});
  auto [text, errors, replaced] =
      Merger(std::move(file), parsed_json(desired.text), local.remote).run();
  auto config = parse(text);
  if (!config) {
    add_parser_errors(errors, std::move(config.error()), replaced);
  } else if (replaced.empty()) {
    errors.add(beyond_limits(local, *config, stop));
  }
  if (!errors.empty()) return tl::unexpected(errors.take());
  return config;
}

}  // namespace fxagent
