// Neuron's JSON: a list of nodes with plugin, params, groups and tags; or four lists (nodes,
// groups, tags, settings) that refer to their driver by name; or one template. Also the tag sheet
// of one node as CSV. Modbus addresses are SLAVE!ADDRESS followed by .BIT, #ENDIAN or .LENGTH.
// Mitsubishi addresses are the device name followed by .BIT or .LENGTH. Type numbers are those of
// Neuron's API.
#include <algorithm>
#include <array>
#include <charconv>
#include <map>
#include <span>
#include <string>

#include "agent/import/csv.h"
#include "agent/import/formats.h"
#include "agent/text/json.h"
#include "agent/text/text.h"
#include "protocol/letter_case.h"

namespace fxagent {
namespace {

using std::string_view_literals::operator""sv;

constexpr std::int64_t kString = 13;
constexpr std::int64_t kWrite = 2;  // bit of the attribute

/// Types of Neuron's API by number: as a sheet names them, and as a config does; empty: none.
constexpr std::array<std::string_view, 19> kNeuronTypes{
    "",       "INT8", "UINT8", "INT16",  "UINT16", "INT32", "UINT32", "INT64", "UINT64", "FLOAT",
    "DOUBLE", "BIT",  "BOOL",  "STRING", "BYTES",  "ERROR", "WORD",   "DWORD", "LWORD"};
constexpr std::array<std::string_view, 19> kConfigTypes{
    "",        "",     "",     "int16",  "uint16", "int32", "uint32", "int64",  "uint64", "float32",
    "float64", "bool", "bool", "string", "",       "",      "uint16", "uint32", "uint64"};

/// Word orders by the number in the node's `endianess` or `endianess_64`; empty: none.
constexpr std::array<std::string_view, 5> kOrders{"", "ABCD", "BADC", "DCBA", "CDAB"};

/// Returns the word for a number; empty if there is none.
std::string_view word_at(std::span<const std::string_view> words, std::int64_t number) {
  return number >= 0 && number < std::ssize(words) ? words[static_cast<std::size_t>(number)] : "";
}

/// Converts the suffix after the #, with ABCD being 1,2,3,4; empty: unknown.
std::string_view order_of(std::string_view endian) {
  if (endian == "LL" || endian == "L") return "ABCD";
  if (endian == "LB" || endian == "B") return "BADC";
  if (endian == "BL") return "CDAB";
  if (endian == "BB") return "DCBA";
  return {};
}

/// Returns the protocol of a plugin; empty if it is not supported.
std::string_view protocol_of(std::string_view plugin) {
  std::string name;
  for (const char c : lower(plugin))
    if (c != ' ' && c != '-' && c != '_') name += c;
  if (name.starts_with("modbusrtu")) return "modbus-rtu";
  if (name.starts_with("modbusascii")) return "modbus-ascii";
  if (name.starts_with("modbus")) return "modbus-tcp";
  if (name.starts_with("mitsubishifx")) return "fx-programming-port";
  if (name.starts_with("mitsubishi3e") || name == "qna3e") return "mc-3e";
  if (name.starts_with("mitsubishi1e") || name == "a1e") return "mc-1e";
  return {};
}

struct TagPlace {
  std::int64_t unit = -1;  ///< -1: the protocol has none
  std::string address;
  std::string_view order{};
  std::int64_t length = 0;
};

/// Removes ".10", ".10H" or ".10L" from the address of a string. Returns false for any other
/// suffix.
bool take_length(std::string_view& text, TagPlace& place) {
  const std::size_t dot = text.find('.');
  if (dot == text.npos) return true;
  const std::string_view length = text.substr(dot + 1);
  const auto number = std::from_chars(length.data(), length.data() + length.size(), place.length);
  const std::string_view rest = length.substr(static_cast<std::size_t>(number.ptr - length.data()));
  if (number.ec != std::errc() || (!rest.empty() && rest != "H" && rest != "L")) return false;
  place.order = rest == "L" ? "low_first" : "high_first";
  text = text.substr(0, dot);
  return true;
}

/// Converts "D20.12" and "SN5" to our spelling: D20.C and STN5. nullopt: a string without a length.
std::optional<TagPlace> melsec_place(std::string_view text, bool is_string) {
  TagPlace place;
  if (is_string && !take_length(text, place)) return std::nullopt;
  const bool is_retentive = text.size() > 2 && text[0] == 'S' &&
                            (text[1] == 'S' || text[1] == 'C' || text[1] == 'N') &&
                            text[2] >= '0' && text[2] <= '9';
  if (is_retentive)
    place.address = "ST" + std::string(text.substr(1));
  else
    place.address = melsec_bit_address(text);
  return place;
}

/// Returns nullopt if the text is not SLAVE!ADDRESS.
std::optional<TagPlace> modbus_place(std::string_view text, bool is_string) {
  const std::size_t mark = text.find('!');
  const std::string_view unit = text.substr(0, mark);
  TagPlace place;
  const auto number = number_from<decltype(place.unit)>(unit);
  if (mark == text.npos || !number) return std::nullopt;
  place.unit = *number;
  text.remove_prefix(mark + 1);
  if (const std::size_t hash = text.find('#'); hash != text.npos) {
    place.order = order_of(text.substr(hash + 1));
    if (place.order.empty()) return std::nullopt;
    text = text.substr(0, hash);
  }
  if (is_string && !take_length(text, place)) return std::nullopt;
  // Counted from 1, with one leading digit for the table.
  place.address = text;
  return place;
}

/// One driver with its groups, from either file layout.
struct Driver {
  const ConfigNode* node = nullptr;
  std::string_view name;
  std::string_view plugin;
  const ConfigNode* params = nullptr;
  struct Group {
    const ConfigNode* node = nullptr;
    std::string_view name;
    std::optional<std::int64_t> interval;
    std::vector<const ConfigNode*> tags;
  };
  std::vector<Group> groups;
};

Driver::Group group_of(const ConfigNode& node) {
  Driver::Group group{&node, text_at(node, "group"), integer_at(node, "interval"), {}};
  if (group.name.empty()) group.name = text_at(node, "name");
  for (const ConfigNode& tag : children_at(node, "tags")) group.tags.push_back(&tag);
  return group;
}

Driver driver_of(const ConfigNode& node) {
  Driver driver{&node, text_at(node, "name"), text_at(node, "plugin"), node.find("params"), {}};
  for (const ConfigNode& group : children_at(node, "groups"))
    driver.groups.push_back(group_of(group));
  return driver;
}

std::vector<Driver> drivers_of(const ConfigNode& top) {
  if (top.find("nodes") == nullptr) return {driver_of(top)};
  std::vector<Driver> drivers;
  for (const ConfigNode& node : children_at(top, "nodes")) drivers.push_back(driver_of(node));
  const auto named = [&](std::string_view name) {
    return std::ranges::find(drivers, name, &Driver::name);
  };
  for (const ConfigNode& node : children_at(top, "groups"))
    if (const auto driver = named(text_at(node, "driver")); driver != drivers.end())
      driver->groups.push_back(group_of(node));
  for (const ConfigNode& node : children_at(top, "tags")) {
    const auto driver = named(text_at(node, "driver"));
    if (driver == drivers.end()) continue;
    const auto group =
        std::ranges::find(driver->groups, text_at(node, "group"), &Driver::Group::name);
    if (group == driver->groups.end()) continue;
    for (const ConfigNode& tag : children_at(node, "tags")) group->tags.push_back(&tag);
  }
  for (const ConfigNode& node : children_at(top, "settings"))
    if (const auto driver = named(text_at(node, "node")); driver != drivers.end())
      driver->params = node.find("params");
  return drivers;
}

class NeuronReader {
 public:
  NeuronReader(const ConfigTree& tree, const ImportOptions& options)
      : tree_(tree), options_(options) {}

  Imported read();

 private:
  /// A device of the driver being read.
  struct Unit {
    std::size_t device = 0;                          ///< index in out_.devices
    std::map<std::string_view, std::string> groups;  ///< with their names in the config
    NameMaker group_names;
    NameMaker tag_names;
  };

  int line_of(const ConfigNode& node) const { return tree_.line_of(node.offset); }
  void note(std::string text) { out_.note(line_of(*driver_.node), std::move(text)); }
  bool is_modbus() const { return protocol_.starts_with("modbus"); }
  void read_driver();
  void read_params();
  std::string port();
  JsonObject serial_settings();
  Unit& unit_of(std::int64_t number);
  const std::string& group_of(const Driver::Group& group, Unit& unit, int line);
  void read_tag(const Driver::Group& group, const ConfigNode& node);

  const ConfigTree& tree_;
  const ImportOptions& options_;
  Imported out_;
  LinkTable links_{out_};
  NameMaker device_names_;
  // State of the driver being read:
  Driver driver_;
  std::string_view protocol_{};
  std::string link_;             ///< empty: not created yet
  std::string_view order_{};     ///< default for tags of two registers
  std::string_view order_64_{};  ///< and of four
  std::map<std::int64_t, Unit> units_;
};

std::string NeuronReader::port() {
  if (!options_.port.empty()) return options_.port;
  if (driver_.params != nullptr) {
    const bool is_ethernet = integer_at(*driver_.params, "link") == 1;
    const std::string_view device = text_at(*driver_.params, "device");
    const std::string_view host = text_at(*driver_.params, "host");
    const auto port = integer_at(*driver_.params, "port");
    if (!is_ethernet && device.starts_with('/')) return std::string(device);
    if (integer_at(*driver_.params, "connection_mode") == 1)
      note("not imported: the device connects to Neuron; an agent connects to the device");
    else if (!host.empty() && port)
      return std::string(host) + ":" + std::to_string(*port);
  }
  note(placeholder_note(protocol_));
  return placeholder_port(protocol_);
}

/// Converts the codes of a serial port. A Modbus node defaults to 9600 8N1.
JsonObject NeuronReader::serial_settings() {
  JsonObject serial;
  if (driver_.params == nullptr) return serial;
  const auto take = [&](std::string_view key, std::string_view ours, std::int64_t usual,
                        const JsonObject& meanings) {
    auto code = integer_at(*driver_.params, key);
    if (!code && is_modbus()) code = usual;
    if (!code) return;
    if (*code >= 0 && *code < std::ssize(meanings))
      serial[ours] = meanings[static_cast<std::size_t>(*code)];
    else
      note("not imported: " + std::string(key) + " " + std::to_string(*code) +
           ", which has no meaning here");
  };
  take("baud", "baud", 4,
       {115200, 57600, 38400, 19200, 9600, 4800, 2400, 1800, 1200, 600, 300, 200, 150});
  take("data", "data_bits", 3, {5, 6, 7, 8});
  take("parity", "parity", 0, {"none", "odd", "even"});
  take("stop", "stop_bits", 0, {1, 2});
  return serial;
}

NeuronReader::Unit& NeuronReader::unit_of(std::int64_t number) {
  const auto [known, fresh] = units_.try_emplace(number);
  if (!fresh) return known->second;
  known->second.device = out_.devices.size();
  std::string wanted = options_.device.empty() ? std::string(driver_.name) : options_.device;
  if (units_.size() > 1) wanted += "_" + std::to_string(number);
  const std::string name = device_names_.make(wanted, "device", line_of(*driver_.node), out_.notes);
  if (link_.empty()) {
    const std::string place = port();
    link_ = links_.to(place, protocol_, line_of(*driver_.node),
                      LinkTable::is_serial(place) == true ? serial_settings() : JsonObject());
  }
  ImportedDevice& device = out_.devices.emplace_back(new_device(name, link_, protocol_));
  if (number >= 0) device.keys["unit"] = number;
  if (!options_.model.empty()) device.keys["model"] = options_.model;
  const auto put_ms = [&](std::string_view theirs, std::string_view ours) {
    const auto ms = integer_at(*driver_.params, theirs);
    if (ms && *ms > 0) device.keys[ours] = *ms;
  };
  if (driver_.params != nullptr) {
    put_ms("timeout", "timeout_ms");
    put_ms("interval", "gap_ms");
  }
  return known->second;
}

/// Returns the name of the group in the config. `line` is that of its first tag.
const std::string& NeuronReader::group_of(const Driver::Group& group, Unit& unit, int line) {
  const auto [known, fresh] = unit.groups.try_emplace(group.name);
  if (!fresh) return known->second;
  known->second = unit.group_names.make(group.name, "group", line, out_.notes);
  JsonObject& made = out_.devices[unit.device].groups.emplace_back();
  made["name"] = known->second;
  if (group.interval) made["interval_ms"] = *group.interval;
  return known->second;
}

void NeuronReader::read_tag(const Driver::Group& group, const ConfigNode& node) {
  const int line = line_of(node);
  const std::string_view name = text_at(node, "name");
  const auto number = integer_at(node, "type").value_or(0);
  const std::string_view type = word_at(kConfigTypes, number);
  if (type.empty())
    return out_.leave_out(line, std::string(name) + " has the type " + std::to_string(number) +
                                    ", which a config does not support");
  const std::string_view address = text_at(node, "address");
  const bool is_string = number == kString;
  auto place = is_modbus() ? modbus_place(address, is_string) : melsec_place(address, is_string);
  if (!place)
    return out_.leave_out(line, std::string(name) + " has the address \"" + std::string(address) +
                                    "\", which a config does not support");
  Unit& unit = unit_of(place->unit);
  const std::string& group_name = group_of(group, unit, line);
  ImportedTag tag{line, {}};
  const std::size_t before = out_.notes.size();
  tag.keys["name"] = unit.tag_names.make(name, "tag", line, out_.notes);
  tag.keys["address"] = literal(place->address);
  tag.keys["type"] = type;
  if (place->length > 0) tag.keys["length"] = place->length;
  if (place->order.empty() && type.ends_with("32")) place->order = order_;
  if (place->order.empty() && type.ends_with("64")) place->order = order_64_;
  if (!place->order.empty() && type != "bool") tag.keys["word_order"] = place->order;
  if (const auto decimal = number_at(node, "decimal"); decimal && *decimal != 0 && *decimal != 1)
    tag.keys["scale"] = json_number(*decimal);
  if (const auto bias = number_at(node, "bias"); bias && *bias != 0)
    tag.keys["offset"] = json_number(*bias);
  if ((integer_at(node, "attribute").value_or(0) & kWrite) != 0) tag.keys["access"] = "read_write";
  if (const std::string_view measured = text_at(node, "unit"); !measured.empty())
    tag.keys["unit"] = literal(measured);
  const bool is_rounded = number_at(node, "precision").value_or(0) != 0;
  note_other_keys(out_, tree_, node, std::string(name),
                  {"name", "address", "type", "attribute", "decimal", "bias", "description", "unit",
                   is_rounded ? "" : "precision"});
  describe(tag, text_at(node, "description"));
  tag.keys["group"] = group_name;
  tag.is_changed = out_.notes.size() > before;
  out_.devices[unit.device].tags.push_back(std::move(tag));
}

/// Reads the settings that apply to all tags of the node.
void NeuronReader::read_params() {
  for (const auto& [key, order] :
       {std::pair("endianess"sv, &order_), std::pair("endianess_64"sv, &order_64_)})
    if (const auto code = integer_at(*driver_.params, key)) {
      *order = word_at(kOrders, *code);
      if (order->empty())
        note("not imported: " + std::string(key) + " " + std::to_string(*code) +
             ", which has no meaning here");
    }
  if (integer_at(*driver_.params, "address_base") == 0)
    note(
        "its addresses count from 0, but those of a config from 1: add 1 to each (400000 is "
        "400001)");
}

void NeuronReader::read_driver() {
  protocol_ = options_.protocol.empty() ? protocol_of(driver_.plugin) : options_.protocol;
  if (protocol_.empty()) {
    if (!driver_.groups.empty())
      note("left out: the node " + std::string(driver_.name) + ", whose plugin \"" +
           std::string(driver_.plugin) + "\" has a protocol that the agent does not support");
    for (const Driver::Group& group : driver_.groups) out_.left_out += group.tags.size();
    return;
  }
  units_.clear();
  link_.clear();
  order_ = order_64_ = {};
  if (driver_.params != nullptr && is_modbus()) read_params();
  const std::string what = "the node " + std::string(driver_.name);
  note_other_keys(out_, tree_, *driver_.node, what,
                  {"name", "plugin", "params", "groups", "nodes", "tags", "settings"});
  if (driver_.params != nullptr)
    note_other_keys(out_, tree_, *driver_.params, what,
                    {"link", "device", "host", "port", "connection_mode", "baud", "data", "parity",
                     "stop", "timeout", "interval", "endianess", "endianess_64", "address_base"});
  for (const Driver::Group& group : driver_.groups)
    note_other_keys(out_, tree_, *group.node, "the group " + std::string(group.name),
                    {"driver", "group", "name", "interval", "tags"});
  for (const Driver::Group& group : driver_.groups)
    for (const ConfigNode* tag : group.tags) read_tag(group, *tag);
}

Imported NeuronReader::read() {
  for (Driver& driver : drivers_of(tree_.root())) {
    driver_ = std::move(driver);
    read_driver();
  }
  return std::move(out_);
}

/// True for the sheet that a tag page exports and imports, or takes as a template. Every sheet has
/// these columns.
bool is_sheet(const std::vector<CsvRow>& rows) {
  return has_columns(rows, {"name", "address", "attribute", "type"});
}

/// Converts the sheet to a node in JSON, with each tag on the line of its row.
std::string json_of_sheet(const std::vector<CsvRow>& rows, const ImportOptions& options) {
  const std::string name = options.device.empty() ? "device1" : options.device;
  std::string groups;
  int line = 1;
  for (auto row = rows.begin() + 1; row != rows.end(); ++row) {
    const auto cell = [&](std::string_view title) {
      return row->at(csv_column(rows.front(), title));
    };
    const auto add_number = [&](JsonObject& object, std::string_view title) {
      if (const auto value = number_from<double>(cell(title))) object[title] = json_number(*value);
    };
    JsonObject tag;
    for (const auto key : {"name", "address", "description", "unit"}) tag[key] = cell(key);
    const auto type = std::ranges::find(kNeuronTypes, cell("type")) - kNeuronTypes.begin();
    tag["type"] = type < std::ssize(kNeuronTypes) ? type : 0;
    tag["attribute"] = cell("attribute").find("Write") == std::string::npos ? 1 : 3;
    for (const auto key : {"decimal", "precision", "bias"}) add_number(tag, key);
    JsonObject group;
    group["name"] = cell("group").empty() ? "default" : cell("group");
    add_number(group, "interval");
    group["tags"].push_back(std::move(tag));
    if (!groups.empty()) groups += ',';
    for (; line < row->line; ++line) groups += '\n';
    groups += dumped(group);
  }
  return R"({"name":)" + dumped(JsonObject(name)) + R"(,"groups":[)" + groups + "]}";
}

}  // namespace

bool is_neuron(std::string_view text) {
  if (const auto rows = read_csv(text); rows && is_sheet(*rows)) return true;
  const auto tree = json_source(text);
  if (!tree) return false;
  const ConfigNode& top = tree->root();
  if (top.find("plugin") != nullptr && top.find("groups") != nullptr) return true;
  const auto& nodes = children_at(top, "nodes");
  return !nodes.empty() && nodes.front().find("plugin") != nullptr;
}

ImportResult import_neuron(std::string_view text, const ImportOptions& options) {
  if (const auto rows = read_csv(text); rows && is_sheet(*rows)) {
    ImportOptions complete = options;
    const std::size_t column = csv_column(rows->front(), "address");
    const bool is_modbus = std::ranges::any_of(*rows, [&](const CsvRow& row) {
      return row.at(column).find('!') != std::string_view::npos;
    });
    if (complete.protocol.empty() && !is_modbus)
      return tl::unexpected(ImportFault{0,
                                        "a sheet of tags does not name its node's plugin: set "
                                        "--protocol to mc-3e, mc-1e or fx-programming-port"});
    if (complete.protocol.empty()) complete.protocol = "modbus-tcp";
    const auto tree = json_source(json_of_sheet(*rows, complete));
    if (!tree) return tl::unexpected(tree.error());
    return NeuronReader(*tree, complete).read();
  }
  const auto tree = json_source(text);
  if (!tree) return tl::unexpected(tree.error());
  if (tree->root().find("nodes") == nullptr && tree->root().find("groups") == nullptr)
    return tl::unexpected(ImportFault{0, "has neither \"nodes\" nor \"groups\""});
  return NeuronReader(*tree, options).read();
}

}  // namespace fxagent
