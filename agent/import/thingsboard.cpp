// modbus.json of the ThingsBoard gateway: the slaves of `master`, with attributes and timeseries
// (read) and attributeUpdates and rpc (written).
#include <cmath>
#include <set>
#include <string>

#include "agent/import/formats.h"
#include "agent/text/json.h"
#include "protocol/letter_case.h"

namespace fxagent {
namespace {

using std::string_view_literals::operator""sv;

/// Returns the table of a Modbus function code; empty if it has none.
std::string_view table_of(std::int64_t function) {
  if (function == 1 || function == 5 || function == 15) return "co";
  if (function == 2) return "di";
  if (function == 4) return "ir";
  return function == 3 || function == 6 || function == 16 ? "hr" : "";
}

/// True if the function of the tag writes.
bool writes(const ConfigNode& tag) {
  const auto function = integer_at(tag, "functionCode");
  return function == 5 || function == 6 || function == 15 || function == 16;
}

/// Returns the table and the address of a tag.
std::pair<std::string_view, std::int64_t> table_and_address(const ConfigNode& tag) {
  return {table_of(integer_at(tag, "functionCode").value_or(0)),
          integer_at(tag, "address").value_or(-1)};
}

/// Converts "16int", "int16" or "int", in lower case; empty if a config has no such type.
std::string_view type_of(std::string_view type, std::int64_t registers) {
  if (type == "16int" || type == "int16") return "int16";
  if (type == "16uint" || type == "uint16") return "uint16";
  if (type == "32int" || type == "int32") return "int32";
  if (type == "32uint" || type == "uint32") return "uint32";
  if (type == "32float" || type == "float32") return "float32";
  if (type == "64int" || type == "int64") return "int64";
  if (type == "64uint" || type == "uint64") return "uint64";
  if (type == "64float" || type == "float64") return "float64";
  if (type == "string") return "string";
  if (type == "bit" || type == "bits") return "bool";
  // Types without a width are as wide as their registers.
  if (registers != 1 && registers != 2 && registers != 4) return {};
  if ((type == "float" || type == "double") && registers > 1)
    return registers == 2 ? "float32" : "float64";
  if (type == "int" || type == "long" || type == "integer")
    return registers == 1 ? "int16" : registers == 2 ? "int32" : "int64";
  if (type == "uint") return registers == 1 ? "uint16" : registers == 2 ? "uint32" : "uint64";
  return {};
}

std::int64_t registers_of(std::string_view type) {
  return type.ends_with("64") ? 4 : type.ends_with("32") ? 2 : 1;
}

/// Returns the order from byteOrder and wordOrder. A tag's own values override those of `slave`.
/// The gateway's default for both is LITTLE.
std::string_view order_of(const ConfigNode& slave, const ConfigNode* tag) {
  const auto is_swapped = [&](std::string_view key) {
    const std::string_view own = tag == nullptr ? ""sv : text_at(*tag, key);
    const std::string_view spelled = own.empty() ? text_at(slave, key) : own;
    return spelled.empty() || lower(spelled) == "little";
  };
  const bool words = is_swapped("wordOrder");
  if (is_swapped("byteOrder")) return words ? "DCBA" : "BADC";
  return words ? "CDAB" : "ABCD";
}

struct Places {
  const ConfigNode* file = nullptr;       ///< the object with "master"
  const ConfigNode* connector = nullptr;  ///< the object around it if there is one, else the same
};

/// Finds the file in an export of the gateway's web page: in `configurationJson`, alone or below
/// the connector's name.
Places places_of(const ConfigNode& top) {
  const auto unwrapped = [](const ConfigNode& node) -> std::optional<Places> {
    const ConfigNode* file = node.find("configurationJson");
    return file == nullptr ? std::nullopt : std::optional(Places{file, &node});
  };
  if (const auto places = unwrapped(top)) return *places;
  if (top.children.size() == 1)
    if (const auto places = unwrapped(top.children.front())) return *places;
  return {&top, &top};
}

class ThingsboardReader {
 public:
  ThingsboardReader(const ConfigTree& tree, const ImportOptions& options)
      : tree_(tree), options_(options) {}

  Imported read();

 private:
  int line_of(const ConfigNode& node) const { return tree_.line_of(node.offset); }
  void read_slave(const ConfigNode& slave);
  void read_publishing(const ConfigNode& slave, IntervalGroups& groups);
  std::string link_of(const ConfigNode& slave, std::string_view protocol);
  void read_tag(const ConfigNode& slave, const ConfigNode& node, ImportedDevice& device,
                IntervalGroups& groups, NameMaker& names);

  const ConfigTree& tree_;
  const ImportOptions& options_;
  const ConfigNode* connector_ = nullptr;  ///< settings from the connector's page of the gateway
  Imported out_;
  LinkTable links_{out_};
  NameMaker device_names_;
  /// Places of the current slave that attributeUpdates and rpc may write, by table and address.
  std::set<std::pair<std::string_view, std::int64_t>> written_;
};

std::string ThingsboardReader::link_of(const ConfigNode& slave, std::string_view protocol) {
  if (!options_.port.empty()) return links_.to(options_.port, protocol);
  // On a serial port `port` is a path; in all other cases it is not a string.
  if (const std::string_view path = text_at(slave, "port"); path.starts_with('/')) {
    // Missing settings take the gateway's defaults.
    JsonObject serial;
    serial["baud"] = integer_at(slave, "baudrate").value_or(19200);
    serial["data_bits"] = integer_at(slave, "bytesize").value_or(8);
    const std::string parity = lower(text_at(slave, "parity"));
    if (parity.empty() || parity == "n" || parity == "e" || parity == "o")
      serial["parity"] = parity == "e" ? "even" : parity == "o" ? "odd" : "none";
    else
      out_.note(line_of(slave), "not imported: the parity \"" + parity + "\"");
    serial["stop_bits"] = integer_at(slave, "stopbits").value_or(1);
    return links_.to(std::string(path), protocol, line_of(slave), serial);
  }
  const std::string_view host = text_at(slave, "host");
  const auto port = integer_at(slave, "port");
  if (!host.empty() && port)
    return links_.to(std::string(host) + ":" + std::to_string(*port), protocol, line_of(slave));
  return links_.to_placeholder(protocol, line_of(slave));
}

void ThingsboardReader::read_tag(const ConfigNode& slave, const ConfigNode& node,
                                 ImportedDevice& device, IntervalGroups& groups, NameMaker& names) {
  const int line = line_of(node);
  const std::string_view name = text_at(node, "tag");
  const auto leave_out = [&](const std::string& why) {
    out_.leave_out(line, std::string(name) + ": " + why);
  };
  const std::size_t before = out_.notes.size();
  const auto registers = integer_at(node, "objectsCount").value_or(1);
  const auto [table, number] = table_and_address(node);
  const std::string spelled = lower(text_at(node, "type"));
  const std::string_view type = type_of(spelled, registers);
  if (type.empty())
    return leave_out("a config has no type \"" + spelled + "\" of " + std::to_string(registers) +
                     " registers");
  std::string address = modbus_address(table, number);
  if (address.empty() || writes(node))
    return leave_out("it has no function that reads, or no address");
  const bool is_bit = is_table_of_bits(table);
  note_other_keys(out_, tree_, node, std::string(name),
                  {"tag", "type", "functionCode", "objectsCount", "address", "bit", "byteOrder",
                   "wordOrder", "divider", "multiplier"});
  ImportedTag tag{line, {}};
  tag.keys["name"] = names.make(name, "tag", line, out_.notes);
  if (type == "bool" && !is_bit) {
    if (registers != 1) return leave_out("it has bits of more than one register");
    address += "." + std::to_string(integer_at(node, "bit").value_or(0));
  }
  tag.keys["address"] = literal(address);
  if (!is_bit) tag.keys["type"] = type;
  if (type == "string") {
    tag.keys["length"] = 2 * registers;
    tag.keys["word_order"] = "high_first";  // regardless of the byte order
  } else if (is_bit && registers > 1) {
    tag.keys["count"] = registers;
  } else if (!is_bit && registers > registers_of(type)) {
    out_.note(line, "not imported: objectsCount " + std::to_string(registers) + " of " +
                        std::string(name) + ": " + spelled + " is one value");
  }
  if (const std::string_view order = order_of(slave, &node);
      !is_bit && type != "bool" && type != "string" && order != order_of(slave, nullptr))
    tag.keys["word_order"] = order;
  const auto factor_of = [&](std::string_view key) {
    const auto value = number_at(node, key);
    return value && *value != 0 ? *value : 1;
  };
  if (const double scale = factor_of("multiplier") / factor_of("divider");
      scale != 1 && !is_bit && type != "bool" && type != "string")
    tag.keys["scale"] = json_number(scale);
  tag.keys["group"] = groups.at(integer_at(slave, "pollPeriod").value_or(5000));
  if (written_.contains({table, number})) tag.keys["access"] = "read_write";
  tag.is_changed = out_.notes.size() > before;
  device.tags.push_back(std::move(tag));
}

/// Reads `sendDataOnlyOnChange` of the slave or the whole connector, and the slave's
/// reportStrategy.
void ThingsboardReader::read_publishing(const ConfigNode& slave, IntervalGroups& groups) {
  const ConfigNode* own = slave.find("sendDataOnlyOnChange");
  const ConfigNode* only = own != nullptr ? own : connector_->find("sendDataOnlyOnChange");
  if (only != nullptr && only->kind == ConfigNode::Kind::boolean && only->boolean)
    groups.publish_on_change(std::nullopt);
  const ConfigNode* strategy = slave.find("reportStrategy");
  if (strategy == nullptr) return;
  const std::string_view kind = text_at(*strategy, "type");
  const auto period = integer_at(*strategy, "reportPeriod");
  if (kind == "ON_CHANGE")
    groups.publish_on_change(std::nullopt);
  else if (kind == "ON_CHANGE_OR_REPORT_PERIOD" && period && *period > 0)
    groups.publish_on_change((*period + 999) / 1000);
  else
    out_.note(line_of(slave), "not imported: the reportStrategy \"" + std::string(kind) +
                                  "\" of the slave " + std::string(text_at(slave, "deviceName")));
}

void ThingsboardReader::read_slave(const ConfigNode& slave) {
  const std::string kind = lower(text_at(slave, "type"));
  const std::string called = "the slave " + std::string(text_at(slave, "deviceName"));
  if (kind == "udp" || kind == "tls") {
    out_.note(line_of(slave), "left out: " + called + " over " + kind);
    for (const auto list : {"attributes"sv, "timeseries"sv})
      out_.left_out += children_at(slave, list).size();
    return;
  }
  const std::string method = lower(text_at(slave, "method"));
  std::string protocol = options_.protocol;
  if (protocol.empty())
    protocol = method == "rtu" ? "modbus-rtu" : method == "ascii" ? "modbus-ascii" : "modbus-tcp";
  const std::string name = device_names_.make(
      options_.device.empty() ? text_at(slave, "deviceName") : std::string_view(options_.device),
      "device", line_of(slave), out_.notes);
  ImportedDevice device = new_device(name, link_of(slave, protocol), protocol);
  device.keys["unit"] = integer_at(slave, "unitId").value_or(1);
  if (const std::string_view order = order_of(slave, nullptr); order != "ABCD")
    device.keys["byte_order"] = order;
  if (const auto seconds = number_at(slave, "timeout"); seconds && *seconds > 0)
    device.keys["timeout_ms"] = json_number(std::round(*seconds * 1000));
  if (const auto gap = integer_at(slave, "delayBetweenRequestsMs"); gap && *gap > 0)
    device.keys["gap_ms"] = *gap;
  note_other_keys(out_, tree_, slave, called,
                  {"type",
                   "method",
                   "host",
                   "port",
                   "baudrate",
                   "bytesize",
                   "parity",
                   "stopbits",
                   "unitId",
                   "deviceName",
                   "byteOrder",
                   "wordOrder",
                   "pollPeriod",
                   "timeout",
                   "delayBetweenRequestsMs",
                   "sendDataOnlyOnChange",
                   "reportStrategy",
                   "attributes",
                   "timeseries",
                   "attributeUpdates",
                   "rpc"});

  written_.clear();
  for (const auto list : {"attributeUpdates"sv, "rpc"sv})
    for (const ConfigNode& node : children_at(slave, list))
      if (writes(node)) written_.insert(table_and_address(node));
  NameMaker names;
  IntervalGroups groups(device);
  read_publishing(slave, groups);
  std::set<std::pair<std::string_view, std::int64_t>> read;
  for (const auto list : {"attributes"sv, "timeseries"sv})
    for (const ConfigNode& node : children_at(slave, list)) {
      read_tag(slave, node, device, groups, names);
      read.insert(table_and_address(node));
    }
  for (const auto list : {"attributeUpdates"sv, "rpc"sv})
    for (const ConfigNode& node : children_at(slave, list))
      if (!read.contains(table_and_address(node)))
        out_.note(line_of(node), "left out: " + std::string(text_at(node, "tag")) + " of " +
                                     std::string(list) + " belongs to no value that is read");
  out_.devices.push_back(std::move(device));
}

Imported ThingsboardReader::read() {
  const Places places = places_of(tree_.root());
  connector_ = places.connector;
  const ConfigNode* master = places.file->find("master");
  for (const ConfigNode& slave : children_at(*master, "slaves")) read_slave(slave);
  note_other_keys(out_, tree_, *master, "\"master\"", {"slaves"});
  note_other_keys(out_, tree_, *places.file, "the file",
                  {"master", "slave", "configurationJson", "sendDataOnlyOnChange"});
  if (const ConfigNode* slave = places.file->find("slave");
      slave != nullptr && !slave->children.empty())
    out_.note(line_of(*slave), "left out: \"slave\", the gateway's own Modbus server");
  return std::move(out_);
}

/// True for the first generation of the gateway's file: one server with its devices.
bool is_first_generation(const ConfigNode& file) {
  const ConfigNode* server = file.find("server");
  return server != nullptr && server->find("devices") != nullptr;
}

}  // namespace

bool is_thingsboard(std::string_view text) {
  const auto tree = json_source(text);
  if (!tree) return false;
  const ConfigNode& file = *places_of(tree->root()).file;
  const ConfigNode* master = file.find("master");
  return is_first_generation(file) || (master != nullptr && master->find("slaves") != nullptr);
}

ImportResult import_thingsboard(std::string_view text, const ImportOptions& options) {
  const auto tree = json_source(text);
  if (!tree) return tl::unexpected(tree.error());
  const ConfigNode& file = *places_of(tree->root()).file;
  if (is_first_generation(file))
    return tl::unexpected(
        ImportFault{tree->line_of(file.find("server")->offset),
                    "\"server\" with \"devices\" is a file of a gateway before version 3, which is "
                    "not supported. A gateway of version 3 converts it to modbus_new.json when it "
                    "starts; import that file"});
  if (file.find("master") == nullptr) return tl::unexpected(ImportFault{0, "has no \"master\""});
  return ThingsboardReader(*tree, options).read();
}

}  // namespace fxagent
