// Telegraf's inputs.modbus in its three styles: `register` (a list for each kind of register),
// `request` and `metric` (fields with a unit of their own).

// toml++ 3.3 asserts that a table name starts with a valid character before it checks it. A debug
// build aborts at `[[;`, and clang's optimizer assumes the assertion. The check afterwards reports
// a proper error with its line, so the assertion is disabled for untrusted text.
#include <toml++/impl/preprocessor.h>
#undef TOML_ASSERT_ASSUME
#define TOML_ASSERT_ASSUME(expression) static_assert(true)
#include <toml++/toml.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <map>
#include <optional>
#include <string>

#include "agent/import/formats.h"
#include "agent/text/json.h"
#include "agent/text/text.h"

namespace fxagent {
namespace {

using std::string_view_literals::operator""sv;

constexpr std::int64_t kDefaultInterval = 10'000;  // default of Telegraf's agent

int line_of(const toml::node& node) { return static_cast<int>(node.source().begin.line); }

std::string_view text_at(const toml::table& table, std::string_view key) {
  return table[key].value_or(""sv);
}
std::optional<std::int64_t> integer_at(const toml::table& table, std::string_view key) {
  return table[key].value<std::int64_t>();
}

/// Returns the tables of an array; empty for any other node.
std::vector<const toml::table*> tables_of(const toml::node_view<const toml::node>& node) {
  std::vector<const toml::table*> tables;
  if (const toml::array* list = node.as_array())
    for (const toml::node& item : *list)
      if (const toml::table* table = item.as_table()) tables.push_back(table);
  return tables;
}

/// Converts "1s", "250ms", "1m30s" to ms; nullopt if it is not a Telegraf duration.
std::optional<std::int64_t> milliseconds(std::string_view text) {
  constexpr std::array<std::pair<std::string_view, double>, 5> kUnits{
      {{"ms", 1}, {"us", 1e-3}, {"s", 1e3}, {"m", 60e3}, {"h", 3600e3}}};
  constexpr double kLongest = 1e15;  // ms, far beyond any interval
  double sum = 0;
  if (text.empty()) return std::nullopt;
  while (!text.empty()) {
    double number = 0;
    const auto [end, fault] = std::from_chars(text.data(), text.data() + text.size(), number);
    if (fault != std::errc()) return std::nullopt;
    text.remove_prefix(static_cast<std::size_t>(end - text.data()));
    const auto unit = std::ranges::find_if(
        kUnits, [&](const auto& known) { return text.starts_with(known.first); });
    if (unit == kUnits.end()) return std::nullopt;
    sum += number * unit->second;
    text.remove_prefix(unit->first.size());
  }
  if (std::isnan(sum)) return std::nullopt;
  return static_cast<std::int64_t>(std::clamp(sum, 0.0, kLongest));
}

/// Returns the config's type; empty if there is none. FIXED and similar types are as wide as their
/// addresses.
std::string_view type_of(std::string_view name, std::size_t registers, bool is_register_style) {
  constexpr std::array<std::pair<std::string_view, std::string_view>, 11> kTelegrafTypes{{
      {"INT16", "int16"},
      {"UINT16", "uint16"},
      {"INT32", "int32"},
      {"UINT32", "uint32"},
      {"INT64", "int64"},
      {"UINT64", "uint64"},
      {"FLOAT32-IEEE", "float32"},
      {"FLOAT64-IEEE", "float64"},
      {"FLOAT64", "float64"},
      {"STRING", "string"},
      {"BIT", "bool"},
  }};
  const auto known =
      std::ranges::find(kTelegrafTypes, name, [](const auto& pair) { return pair.first; });
  if (known != kTelegrafTypes.end()) return known->second;
  if (name == "FLOAT32" && !is_register_style) return "float32";
  if (registers != 1 && registers != 2 && registers != 4) return {};
  if (name == "FIXED") return registers == 1 ? "int16" : registers == 2 ? "int32" : "int64";
  if (name == "UFIXED" || name == "FLOAT32")
    return registers == 1 ? "uint16" : registers == 2 ? "uint32" : "uint64";
  return {};
}

std::string_view table_of(std::string_view name) {
  if (name == "coil" || name == "coils") return "co";
  if (name == "discrete" || name == "discrete_inputs") return "di";
  if (name == "input" || name == "input_registers") return "ir";
  return name.empty() || name == "holding" || name == "holding_registers" ? "hr" : "";
}

/// Converts a byte order. "AB" and "BA" apply to one register, eight letters to four.
std::string_view word_order_of(std::string_view name) {
  if (name == "AB") return {};
  if (name == "BA" || name == "BADCFEHG") return "BADC";
  if (name == "ABCDEFGH") return "ABCD";
  if (name == "GHEFCDAB") return "CDAB";
  return name == "HGFEDCBA" ? "DCBA"sv : name;
}

/// True if the first byte of a string is the high byte of its register.
bool is_high_first(std::string_view order) {
  return order.empty() || order == "ABCD" || order == "CDAB";
}

class TelegrafReader {
 public:
  explicit TelegrafReader(const ImportOptions& options) : options_(options) {}

  Imported read(const toml::table& top);

 private:
  struct Field {
    std::string_view table{};
    std::string_view order{};
    bool is_register_style = false;
  };

  void list_unread_keys(const toml::table& table, const std::string& what,
                        std::initializer_list<std::string_view> known);
  void read_plugin(const toml::table& plugin, std::int64_t interval);
  std::string link_of(const toml::table& plugin);
  ImportedDevice& device_of(std::int64_t unit, int line);
  void read_field(const toml::table& node, std::int64_t unit, Field field);

  const ImportOptions& options_;
  Imported out_;
  LinkTable links_{out_};
  NameMaker device_names_;
  // State of the plugin being read:
  std::string name_;
  std::string link_;
  std::string protocol_;
  std::optional<std::int64_t> timeout_;
  std::optional<std::int64_t> pause_;
  std::int64_t interval_ = kDefaultInterval;
  std::string group_;                          ///< name of the single group of each device
  std::map<std::int64_t, std::size_t> units_;  ///< index in out_.devices
  std::map<std::int64_t, NameMaker> tag_names_;
  struct Measurement {
    int line = 0;  ///< of the first field
    std::size_t fields = 0;
  };
  std::map<std::string, Measurement, std::less<>> measurements_;
};

/// Notes the keys of `table` that are not in `known`. `what` names the table.
void TelegrafReader::list_unread_keys(const toml::table& table, const std::string& what,
                                      std::initializer_list<std::string_view> known) {
  std::string keys;
  for (const auto& [key, value] : table)
    if (std::ranges::find(known, key.str()) == known.end())
      keys += (keys.empty() ? "" : ", ") + std::string(key.str());
  if (!keys.empty()) out_.note(line_of(table), "not imported: " + keys + " of " + what);
}

/// Returns the link of a plugin. Sets its protocol, which the transmission mode determines.
std::string TelegrafReader::link_of(const toml::table& plugin) {
  std::string_view controller = text_at(plugin, "controller");
  std::string mode(text_at(plugin, "transmission_mode"));
  const bool is_tcp = controller.starts_with("tcp://");
  if (mode.empty() || mode == "auto") mode = is_tcp || controller.empty() ? "TCP" : "RTU";
  protocol_ = mode.starts_with("RTU")     ? "modbus-rtu"
              : mode.starts_with("ASCII") ? "modbus-ascii"
                                          : "modbus-tcp";
  if (!options_.protocol.empty()) protocol_ = options_.protocol;
  if (!options_.port.empty()) return links_.to(options_.port, protocol_);
  if (is_tcp) {
    std::string port(controller.substr("tcp://"sv.size()));
    if (port.find(':') == port.npos || port.ends_with(']')) port += ":502";
    return links_.to(port, protocol_, line_of(plugin));
  }
  if (controller.starts_with("file://")) controller.remove_prefix("file://"sv.size());
  if (controller.starts_with('/')) {
    JsonObject serial;
    if (const auto baud = integer_at(plugin, "baud_rate")) serial["baud"] = *baud;
    if (const auto bits = integer_at(plugin, "data_bits")) serial["data_bits"] = *bits;
    const std::string_view parity = text_at(plugin, "parity");
    if (parity == "N" || parity == "E" || parity == "O")
      serial["parity"] = parity == "N" ? "none" : parity == "E" ? "even" : "odd";
    if (const auto bits = integer_at(plugin, "stop_bits")) serial["stop_bits"] = *bits;
    return links_.to(std::string(controller), protocol_, line_of(plugin), serial);
  }
  return links_.to_placeholder(protocol_, line_of(plugin));
}

ImportedDevice& TelegrafReader::device_of(std::int64_t unit, int line) {
  const auto [known, fresh] = units_.try_emplace(unit, out_.devices.size());
  if (!fresh) return out_.devices[known->second];
  const std::string wanted = units_.size() > 1 ? name_ + "_" + std::to_string(unit) : name_;
  ImportedDevice device =
      new_device(device_names_.make(wanted, "device", line, out_.notes), link_, protocol_);
  device.keys["unit"] = unit;
  if (timeout_ && *timeout_ > 0) device.keys["timeout_ms"] = *timeout_;
  if (pause_ && *pause_ > 0) device.keys["gap_ms"] = *pause_;
  group_ = IntervalGroups(device).at(interval_);
  return out_.devices.emplace_back(std::move(device));
}

void TelegrafReader::read_field(const toml::table& node, std::int64_t unit, Field field) {
  const int line = line_of(node);
  const std::string name(text_at(node, "name"));
  if (node["omit"].value_or(false)) return;
  const auto leave_out = [&](const std::string& why) { out_.leave_out(line, name + ": " + why); };
  std::vector<std::int64_t> addresses;
  if (const toml::array* list = node["address"].as_array())
    for (const toml::node& item : *list) addresses.push_back(item.value_or(std::int64_t{-1}));
  else
    addresses.push_back(integer_at(node, "address").value_or(-1));
  // The `register` style lists the registers of a string; the other styles count them.
  const std::int64_t string_registers = field.is_register_style
                                            ? static_cast<std::int64_t>(addresses.size())
                                            : integer_at(node, "length").value_or(0);
  for (std::size_t i = 1; i < addresses.size(); ++i)
    if (addresses[i] != addresses[i - 1] + 1) return leave_out("its addresses are not consecutive");
  std::string address =
      addresses.empty() ? std::string() : modbus_address(field.table, addresses[0]);
  if (address.empty()) return leave_out("it has no Modbus address");

  ImportedTag tag{line, {}};
  const bool is_bit = is_table_of_bits(field.table);
  const std::string_view spelled = text_at(node, field.is_register_style ? "data_type" : "type");
  const std::string_view type =
      is_bit ? "bool" : type_of(spelled, addresses.size(), field.is_register_style);
  if (type.empty()) return leave_out("a config has no type \"" + std::string(spelled) + "\"");
  if (type == "bool" && !is_bit)
    address += "." + std::to_string(integer_at(node, "bit").value_or(0));
  ImportedDevice& device = device_of(unit, line);
  const std::size_t before = out_.notes.size();
  tag.keys["name"] = tag_names_[unit].make(name, "tag", line, out_.notes);
  tag.keys["address"] = literal(address);
  if (!is_bit) tag.keys["type"] = type;
  const std::string_view order =
      word_order_of(field.is_register_style ? text_at(node, "byte_order") : field.order);
  if (type == "string") {
    tag.keys["length"] = 2 * string_registers;
    tag.keys["word_order"] = is_high_first(order) ? "high_first" : "low_first";
  } else if (type != "bool") {
    if (!order.empty()) tag.keys["word_order"] = order;
    const auto scale = node["scale"].value<double>();
    if (scale && *scale != 0 && *scale != 1) tag.keys["scale"] = json_number(*scale);
  }
  list_unread_keys(node, name,
                   {"name", "address", "data_type", "type", "byte_order", "scale", "bit",
                    "measurement", "omit", "register", type == "string" ? "length" : ""});
  tag.is_changed = out_.notes.size() > before;
  if (const std::string_view measurement = text_at(node, "measurement"); !measurement.empty()) {
    Measurement& known = measurements_[std::string(measurement)];
    if (known.fields++ == 0) known.line = line;
    tag.is_changed = true;
  }
  tag.keys["group"] = group_;
  device.tags.push_back(std::move(tag));
}

void TelegrafReader::read_plugin(const toml::table& plugin, std::int64_t interval) {
  units_.clear();
  tag_names_.clear();
  name_ = options_.device.empty() ? std::string(text_at(plugin, "name")) : options_.device;
  link_ = link_of(plugin);
  timeout_ = milliseconds(text_at(plugin, "timeout"));
  pause_ = milliseconds(text_at(plugin, "pause_between_requests"));
  list_unread_keys(
      plugin, "inputs.modbus \"" + name_ + "\"",
      {"name", "controller", "transmission_mode", "baud_rate", "data_bits", "parity", "stop_bits",
       "timeout", "pause_between_requests", "interval", "slave_id", "configuration_type",
       "discrete_inputs", "coils", "holding_registers", "input_registers", "request", "metric"});
  interval_ = milliseconds(text_at(plugin, "interval")).value_or(interval);
  const auto unit = integer_at(plugin, "slave_id").value_or(1);
  for (const auto list :
       {"discrete_inputs"sv, "coils"sv, "holding_registers"sv, "input_registers"sv})
    for (const toml::table* node : tables_of(plugin[list]))
      read_field(*node, unit, {table_of(list), {}, true});
  for (const auto style : {"request"sv, "metric"sv})
    for (const toml::table* request : tables_of(plugin[style])) {
      list_unread_keys(*request, "the " + std::string(style),
                       {"slave_id", "byte_order", "register", "fields", "tags"});
      for (const toml::table* node : tables_of((*request)["fields"])) {
        const toml::table& place = style == "metric" ? *node : *request;
        read_field(*node, integer_at(*request, "slave_id").value_or(0),
                   {table_of(text_at(place, "register")), text_at(*request, "byte_order"), false});
      }
      if (request->contains("tags"))
        out_.note(line_of(*request), "not imported: the tags of the request");
    }
}

Imported TelegrafReader::read(const toml::table& top) {
  const auto interval =
      milliseconds(top["agent"]["interval"].value_or(""sv)).value_or(kDefaultInterval);
  for (const toml::table* plugin : tables_of(top["inputs"]["modbus"]))
    read_plugin(*plugin, interval);
  for (const auto& [name, known] : measurements_)
    out_.note(known.line, "not imported: the measurement \"" + name + "\" of " +
                              counted(known.fields, "field"));
  if (const toml::table* inputs = top["inputs"].as_table())
    for (const auto& [name, node] : *inputs)
      if (name != "modbus")
        out_.note(line_of(node),
                  "left out: inputs." + std::string(name.str()) + ", which is not Modbus");
  return std::move(out_);
}

/// Returns the line where keys or brackets nest deeper than 32 levels; nullopt if none does. toml++
/// recurses once for each level and reports no line for it. This scan must recognise strings
/// exactly as toml++ does, or levels could hide in them. Text after the first syntax error does not
/// matter: toml++ stops there.
std::optional<int> too_deep_line(std::string_view text) {
  constexpr std::size_t kMostLevels = 32;
  int line = 1;
  std::size_t names = 0;  // of the current key
  std::size_t brackets = 0;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (c == '"' || c == '\'') {
      const std::string triple(3, c);
      const bool is_long = text.substr(i).starts_with(triple);
      i += is_long ? 3 : 1;
      while (i < text.size()) {
        if (is_long ? text.substr(i).starts_with(triple) : text[i] == c || text[i] == '\n') break;
        if (text[i] == '\n') ++line;
        i += c == '"' && text[i] == '\\' && text.substr(i + 1, 1) != "\n" ? 2U : 1U;
      }
      if (i >= text.size()) break;
      if (is_long) {
        i += 2;
        // Up to two quotes may precede the three that end the string.
        for (int more = 0; more < 2 && text.substr(i + 1, 1) == triple.substr(0, 1); ++more) ++i;
      }
      if (text[i] != '\n') continue;
    }
    switch (text[i]) {
      case '#':
        i = std::min(text.find('\n', i), text.size()) - 1;
        break;
      case '\n':
        ++line;
        [[fallthrough]];
      case '=':
      case ',':
        names = 0;
        break;
      case '[':
      case '{':
        names = 0;
        if (++brackets > kMostLevels) return line;
        break;
      case ']':
      case '}':
        brackets -= brackets > 0 ? 1 : 0;
        break;
      case '.':
        if (++names > kMostLevels) return line;
        break;
      default:
        break;
    }
  }
  return std::nullopt;
}

/// Parses TOML; the error has the line of the fault. Replaces non-ASCII characters by U+FFFD:
/// nothing that is converted contains them, and toml++ 3.3 has undefined behaviour
/// (TOML_UNREACHABLE in is_whitespace()) for some of them outside strings and comments.
tl::expected<toml::table, ImportFault> parsed(std::string_view text) {
  if (const auto line = too_deep_line(text))
    return tl::unexpected(ImportFault{*line, "more than 32 levels of nested names or brackets"});
  std::string plain;
  for (const char each : text) {
    const auto byte = static_cast<unsigned char>(each);
    if (byte < 0x80)
      plain += each;
    else if (byte >= 0xC0)  // first byte of a character, not a continuation byte
      plain += "\xEF\xBF\xBD";
  }
  try {
    return toml::parse(plain);
  } catch (const toml::parse_error& error) {
    return tl::unexpected(
        ImportFault{static_cast<int>(error.source().begin.line), std::string(error.description())});
  }
}

}  // namespace

bool is_telegraf(std::string_view text) {
  if (text.find("inputs.modbus") == text.npos) return false;
  const auto top = parsed(text);
  return top && (*top)["inputs"]["modbus"].is_array();
}

ImportResult import_telegraf(std::string_view text, const ImportOptions& options) {
  const auto top = parsed(text);
  if (!top) return tl::unexpected(top.error());
  if (!(*top)["inputs"]["modbus"].is_array())
    return tl::unexpected(ImportFault{0, "has no [[inputs.modbus]]"});
  return TelegrafReader(options).read(*top);
}

}  // namespace fxagent
