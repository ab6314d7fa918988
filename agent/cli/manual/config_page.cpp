#include "agent/cli/manual/config_page.h"

#include <array>
#include <cstddef>
#include <string_view>
#include <variant>

#include "agent/cli/manual/command_pages.h"
#include "agent/config/keys.h"
#include "protocol/catalog.h"

namespace fxagent {
namespace {

std::string type_of(const ConfigKey& key) {
  using Type = ConfigKey::Type;
  constexpr std::array kWords{"name",         "text", "path",   "",      "number",
                              "true | false", "",     "object", "array", "range or list"};
  static_assert(kWords.size() == static_cast<std::size_t>(Type::numbers) + 1);
  if (key.type == Type::integer)
    return std::to_string(key.limits.min) + " to " + std::to_string(key.limits.max);
  if (key.type != Type::choice) return kWords[static_cast<std::size_t>(key.type)];
  std::string words;
  for (const std::string_view word : key.limits.words)
    words += (words.empty() ? "" : " | ") + std::string(word);
  return words;
}

std::string default_of(const ConfigKey& key) {
  if (key.is_required()) return "required";
  if (const auto* rule = std::get_if<ConfigKey::Rule>(&key.fallback))
    return "default: " + std::string(rule->text);
  if (const auto* number = std::get_if<std::int64_t>(&key.fallback))
    return "default: " + std::to_string(*number);
  if (const auto* flag = std::get_if<bool>(&key.fallback))
    return *flag ? "default: true" : "default: false";
  if (const auto* word = std::get_if<std::string_view>(&key.fallback))
    return "default: " + std::string(*word);
  return "optional";
}

/// Removes the backquotes of Markdown.
std::string plain(std::string_view text) {
  std::string out(text);
  std::erase(out, '`');
  return out;
}

std::string entry(const ConfigKey& key) {
  return ".TP\n\\fB" + roff(key.name) + "\\fR: " + roff(type_of(key)) + " (" +
         roff(plain(default_of(key))) + ")\n" + roff(plain(key.meaning)) + "\n";
}

}  // namespace

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
