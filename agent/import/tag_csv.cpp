// Converts the tags of a config to CSV and back, for editing in a spreadsheet.
#include <algorithm>
#include <map>
#include <set>

#include "agent/config/json/pretty.h"
#include "agent/config/json/tree.h"
#include "agent/config/keys.h"
#include "agent/import/csv.h"
#include "agent/import/formats.h"

namespace fxagent {
namespace {

using Kind = ConfigNode::Kind;

constexpr std::string_view kDeviceColumn = "device";
constexpr std::string_view kDeviceRow = "#device";
constexpr std::string_view kLinkRow = "#link";

std::span<const ConfigKey> tag_keys() { return config_section("devices[].tags[]"); }

/// True for keys whose cells hold JSON; all other cells are plain text.
bool is_json(const ConfigKey& key) {
  return key.is_number() || key.type == ConfigKey::Type::object;
}

std::string json_of(const ConfigNode& node) {
  std::string out;
  append_pretty(out, node, 0);
  // Join into one line, so that a row stays on one line. Strings contain no raw line end, only
  // escapes.
  std::string line;
  for (std::size_t i = 0; i < out.size(); ++i) {
    if (out[i] != '\n') {
      line += out[i];
      continue;
    }
    while (i + 1 < out.size() && out[i + 1] == ' ') ++i;
  }
  return line;
}

/// Returns the cell for a key of a tag; nullopt if the tag does not have the key.
std::optional<std::string> cell_of(const ConfigNode& tag, const ConfigKey& key) {
  const ConfigNode* node = tag.find(key.name);
  if (node == nullptr) return std::nullopt;
  return node->kind == Kind::string ? node->text : json_of(*node);
}

/// True if a row can hold the tag: no key has `{n}` in place of a number.
bool fits_a_row(const ConfigNode& tag) {
  return std::ranges::all_of(tag_keys(), [&](const ConfigKey& key) {
    const ConfigNode* node = tag.find(key.name);
    return node == nullptr || is_json(key) == (node->kind != Kind::string);
  });
}

void add_row(std::string& out, std::string_view name, const ConfigNode& node) {
  out += "#" + std::string(name) + "," + csv_cell(json_of(node)) + "\n";
}

/// Returns the names of entries whose tags may go into rows: those that occur once.
std::set<std::string_view> names_for_rows(const std::vector<ConfigNode>& devices) {
  std::map<std::string_view, int> times;
  for (const ConfigNode& device : devices) ++times[text_at(device, "name")];
  std::set<std::string_view> names;
  for (const auto& [name, count] : times)
    if (count == 1 && !name.empty() && !name.starts_with('#')) names.insert(name);
  return names;
}

void add_tags(std::string& out, const ConfigNode& device) {
  for (const ConfigNode& tag : children_at(device, "tags")) {
    out += csv_cell(std::string(text_at(device, "name")));
    for (const ConfigKey& key : tag_keys()) out += "," + csv_cell(cell_of(tag, key));
    out += "\n";
  }
}

// ---- import -----------------------------------------------------------------------------------

/// True if the text is JSON of the kind that the key accepts.
bool is_json_of(const ConfigKey& key, const std::string& text) {
  const auto tree = ConfigTree::parse(text);
  if (!tree) return false;
  const Kind kind = tree->root().kind;
  return key.is_number() ? kind == Kind::integer || kind == Kind::number : kind == Kind::object;
}

bool has_tags(const std::vector<CsvRow>& rows) {
  // Only Neuron's sheet has an attribute.
  return has_columns(rows, {"name", "address"}) && !has_columns(rows, {"attribute"});
}

class TagCsvReader {
 public:
  explicit TagCsvReader(const ImportOptions& options) : options_(options) {}

  ImportResult read(const std::vector<CsvRow>& rows);

 private:
  void take_section(const CsvRow& row);
  void take_tag(const CsvRow& row);
  ImportedDevice& device_of(const std::string& name);

  const ImportOptions& options_;
  Imported out_;
  LinkTable links_{out_};
  std::vector<std::size_t> columns_;  ///< one for each of tag_keys(), then the device's
  std::size_t group_column_ = 0;
  bool is_whole_ = false;                       ///< the file has rows that define the devices
  std::map<std::string, std::size_t> devices_;  ///< name to index in out_.devices
  std::set<std::pair<std::string, std::string>> groups_;  ///< created for devices without a row
};

/// Reads a row that starts with #.
void TagCsvReader::take_section(const CsvRow& row) {
  const std::string json = row.cells.size() > 1 && row.cells[1] ? *row.cells[1] : std::string();
  const auto tree = json_source(json);
  if (!tree) {
    out_.note(row.line, "left out: " + tree.error().text);
    return;
  }
  if (row.at(0) == kLinkRow || row.at(0) == kDeviceRow) {
    JsonObject object = JsonObject::object();
    for (const ConfigNode& member : tree->root().children)
      if (!object.emplace(member.key, JsonObject::parse(json_of(member))).second)
        out_.note(row.line, "left out: the second " + member.key);
    if (row.at(0) == kLinkRow) {
      out_.links.push_back(std::move(object));
      return;
    }
    for (const std::string_view key : {"groups", "tags"})
      if (object.contains(key) && !object[std::string(key)].is_array())
        return out_.note(row.line, "left out: " + std::string(key) + " must be an array");
    const std::string name(text_at(tree->root(), "name"));
    if (children_at(tree->root(), "tags").empty()) devices_.try_emplace(name, out_.devices.size());
    is_whole_ = true;
    out_.devices.push_back({.keys = std::move(object), .may_be_empty = true});
    return;
  }
  const std::string name(row.at(0).substr(1));
  if (name == "links" || name == "devices")
    out_.note(row.line, "left out: " + name + " have a row each, #link or #device");
  else if (!out_.sections.emplace(name, JsonObject::parse(json)).second)
    out_.note(row.line, "left out: the second " + name);
}

/// Returns the device of that name. If the file has no row for it, creates it from the caller's
/// options.
ImportedDevice& TagCsvReader::device_of(const std::string& name) {
  const auto [known, fresh] = devices_.try_emplace(name, out_.devices.size());
  if (!fresh) {
    out_.devices[known->second].keys.erase("tags");  // an empty list, replaced by the tags in rows
    return out_.devices[known->second];
  }
  return add_device(out_, links_, options_, name, "fx-programming-port");
}

void TagCsvReader::take_tag(const CsvRow& row) {
  const auto keys = tag_keys();
  ImportedTag tag{row.line, {}};
  for (std::size_t i = 0; i < keys.size(); ++i) {
    const std::size_t column = columns_[i];
    if (column >= row.cells.size() || !row.cells[column]) continue;
    const std::string& cell = *row.cells[column];
    if (!is_json(keys[i])) {
      // A spreadsheet does not distinguish an empty text from no text.
      if (!cell.empty() || keys[i].name == "unit") tag.keys[keys[i].name] = cell;
    } else if (is_json_of(keys[i], std::string(row.at(column)))) {
      tag.keys[keys[i].name] = JsonObject::parse(row.at(column));
    } else if (!row.at(column).empty()) {
      tag.keys[keys[i].name] = cell;  // the loader reports it with the other faults of the row
      if (keys[i].type == ConfigKey::Type::number && cell.find(',') != cell.npos)
        out_.note(row.line, std::string(keys[i].name) + " \"" + cell + "\": write a decimal point");
    }
  }
  std::string name(row.at(columns_.back()));
  if (name.empty()) name = options_.device.empty() ? "device1" : options_.device;
  if (is_whole_ && !devices_.contains(name))
    return out_.leave_out(row.line, "there is no device " + name + " with its tags in rows");
  ImportedDevice& device = device_of(name);
  // A file with tags alone gives only the names of their groups.
  const std::string group(row.at(group_column_));
  if (!device.may_be_empty && !group.empty() && groups_.emplace(name, group).second)
    device.groups.push_back(JsonObject::object({{"name", group}}));
  device.tags.push_back(std::move(tag));
}

ImportResult TagCsvReader::read(const std::vector<CsvRow>& rows) {
  for (const ConfigKey& key : tag_keys()) columns_.push_back(csv_column(rows.front(), key.name));
  columns_.push_back(csv_column(rows.front(), kDeviceColumn));
  group_column_ = csv_column(rows.front(), "group");
  for (std::size_t i = 0; i < rows.front().cells.size(); ++i)
    if (!contains(columns_, i) && !rows.front().at(i).empty())
      out_.note(rows.front().line, "left out: the column \"" + std::string(rows.front().at(i)) +
                                       "\", which is not a key of a tag");
  for (const CsvRow& row : rows)
    if (row.at(0).starts_with('#')) take_section(row);
  for (std::size_t i = 1; i < rows.size(); ++i)
    if (!rows[i].at(0).starts_with('#')) take_tag(rows[i]);
  out_.has_raw_names = true;
  return std::move(out_);
}

}  // namespace

std::string export_csv(std::string_view text) {
  const auto tree = ConfigTree::parse(text, ConfigTree::Folding::none, kAnyTree, Comments::allowed);
  if (!tree) return {};
  const ConfigNode& top = tree->root();
  std::string out(kDeviceColumn);
  for (const ConfigKey& key : tag_keys()) out += "," + std::string(key.name);
  out += "\n";
  std::string sections;
  for (const ConfigNode& member : top.children)
    if (member.key != "links" && member.key != "devices") add_row(sections, member.key, member);
  for (const ConfigNode& link : children_at(top, "links")) add_row(sections, "link", link);
  const auto& devices = children_at(top, "devices");
  const auto names = names_for_rows(devices);
  for (const ConfigNode& node : devices) {
    const auto& tags = children_at(node, "tags");
    const bool in_rows = names.contains(text_at(node, "name")) && !tags.empty() &&
                         std::ranges::all_of(tags, fits_a_row);
    ConfigNode device = node;
    if (in_rows) {
      add_tags(out, node);
      std::erase_if(device.children, [](const ConfigNode& key) { return key.key == "tags"; });
    }
    add_row(sections, "device", device);
  }
  return out + sections;
}

bool is_tag_csv(std::string_view text) {
  const auto rows = read_csv(text);
  return rows && has_tags(*rows);
}

ImportResult import_tag_csv(std::string_view text, const ImportOptions& options) {
  const auto rows = read_csv(text);
  if (!rows) return tl::unexpected(rows.error());
  if (!has_tags(*rows))
    return tl::unexpected(ImportFault{0, "has no columns \"name\" and \"address\""});
  return TagCsvReader(options).read(*rows);
}

}  // namespace fxagent
