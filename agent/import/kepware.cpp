// Tags of one device in KEPServerEX's CSV export. Tag groups are part of the name. The file does
// not contain the settings of channel and device (port, station, byte order).
#include <algorithm>
#include <array>
#include <optional>
#include <string>

#include "agent/import/csv.h"
#include "agent/import/formats.h"
#include "agent/text/json.h"
#include "agent/text/text.h"
#include "protocol/letter_case.h"

namespace fxagent {
namespace {

constexpr std::array<std::pair<std::string_view, std::string_view>, 14> kTypes{{
    {"boolean", "bool"},
    {"short", "int16"},
    {"word", "uint16"},
    {"long", "int32"},
    {"dword", "uint32"},
    {"llong", "int64"},
    {"qword", "uint64"},
    {"float", "float32"},
    {"double", "float64"},
    {"bcd", "bcd16"},
    {"lbcd", "bcd32"},
    {"string", "string"},
    {"default", ""},
    {"", ""},
}};

bool is_digit(char c) { return c >= '0' && c <= '9'; }
bool begins_with_digit(std::string_view text) { return !text.empty() && is_digit(text.front()); }

/// Address converted from Kepware's spelling to ours.
struct Place {
  std::string address;
  std::optional<std::int64_t> count{};   ///< "400001 [10]"
  std::optional<std::int64_t> length{};  ///< "400001.20H"
  std::string word_order{};              ///< for a string
};

/// Parses "DSH0100.020": a string of 20 characters from D100, first character in the high byte;
/// DSL: in the low byte. W and R strings have the same form.
std::optional<Place> melsec_string(std::string_view text) {
  if (text.size() < 4 || text[1] != 'S' || (text[2] != 'H' && text[2] != 'L')) return std::nullopt;
  const std::size_t dot = text.find('.');
  if (!is_digit(text[3]) || dot == text.npos) return std::nullopt;
  Place place;
  place.address = text.substr(0, 1);
  place.address += text.substr(3, dot - 3);
  place.length = number_from<std::int64_t>(text.substr(dot + 1));
  place.word_order = text[2] == 'H' ? "high_first" : "low_first";
  return place;
}

/// Parses "400001" and "400001.3", which a config spells the same way, and "400001.20H": a string
/// of 20 characters, first character in the high byte; L: in the low byte.
Place place_of(std::string_view text, bool is_string) {
  Place place;
  if (const std::size_t bracket = text.find('['); bracket != text.npos && text.ends_with(']')) {
    place.count = number_from<std::int64_t>(text.substr(bracket + 1, text.size() - bracket - 2));
    text = text.substr(0, bracket);
    while (text.ends_with(' ')) text.remove_suffix(1);
  }
  if (is_string)
    if (auto melsec = melsec_string(text)) return *std::move(melsec);
  const std::size_t dot = text.find('.');
  if (is_string && dot != text.npos) {
    std::string_view length = text.substr(dot + 1);
    if (length.ends_with('H') || length.ends_with('L')) {
      place.word_order = length.ends_with('H') ? "high_first" : "low_first";
      length.remove_suffix(1);
    }
    place.length = number_from<std::int64_t>(length);
    text = text.substr(0, dot);
  }
  place.address = begins_with_digit(text) ? std::string(text) : melsec_bit_address(text);
  return place;
}

/// Reads rows one by one into the tags of a device.
class TagReader {
 public:
  TagReader(Imported& out, ImportedDevice& device, const CsvRow& head)
      : out_(out), device_(device), groups_(device), head_(head) {}

  void take(const CsvRow& row);

 private:
  std::string_view cell(const CsvRow& row, std::string_view title) const {
    return row.at(csv_column(head_, title));
  }
  void leave_out(const CsvRow& row, const std::string& why) { out_.leave_out(row.line, why); }
  bool add_scaling(const CsvRow& row, ImportedTag& tag);
  void add_limits(const CsvRow& row, ImportedTag& tag);

  Imported& out_;
  ImportedDevice& device_;
  IntervalGroups groups_;
  NameMaker names_{NameMaker::Source::name};
  const CsvRow& head_;  ///< the titles of the columns
};

/// Returns false if the config would scale the values wrongly.
bool TagReader::add_scaling(const CsvRow& row, ImportedTag& tag) {
  const std::string mode = lower(cell(row, "Scaling"));
  const bool is_negated = cell(row, "Negate Value") == "1";
  double scale = 1;
  double offset = 0;
  if (mode == "linear") {
    const auto from = number_from<double>(cell(row, "Raw Low"));
    const auto to = number_from<double>(cell(row, "Raw High"));
    const auto low = number_from<double>(cell(row, "Scaled Low"));
    const auto high = number_from<double>(cell(row, "Scaled High"));
    if (!from || !to || !low || !high || *from == *to || *low == *high) {
      leave_out(row, "its linear scaling has an empty range");
      return false;
    }
    scale = (*high - *low) / (*to - *from);
    offset = *low - *from * scale;
  } else if (!mode.empty() && mode != "none") {
    leave_out(row, "scaling \"" + mode + "\" is not supported by a config");
    return false;
  }
  if (is_negated && mode == "linear") {
    scale = -scale;
    offset = -offset;
  }
  if (scale != 1) tag.keys["scale"] = json_number(scale);
  if (offset != 0) tag.keys["offset"] = json_number(offset);
  return true;
}

/// Imports the clamps of a correct linear scaling as limits of commands.
void TagReader::add_limits(const CsvRow& row, ImportedTag& tag) {
  if (lower(cell(row, "Scaling")) != "linear") return;
  const bool is_negated = cell(row, "Negate Value") == "1";
  const double low = number_from<double>(cell(row, "Scaled Low")).value_or(0);
  const double high = number_from<double>(cell(row, "Scaled High")).value_or(0);
  bool is_clamped = false;
  const auto add = [&](std::string_view title, double end, bool is_least) {
    if (cell(row, title) != "1") return;
    is_clamped = true;
    if (tag.keys.contains("access"))
      tag.keys[is_least != is_negated ? "min" : "max"] = json_number(is_negated ? -end : end);
  };
  add("Clamp Low", low, low < high);
  add("Clamp High", high, high < low);
  if (is_clamped)
    out_.note(row.line, tag.keys.contains("access")
                            ? "clamping is imported as min and max: a command with a value beyond "
                              "them is refused, and a value that is read is not clamped"
                            : "not imported: clamping; a value that is read is not clamped");
}

void TagReader::take(const CsvRow& row) {
  const std::string_view name = cell(row, "Tag Name");
  std::string type = lower(cell(row, "Data Type"));
  const bool is_array = type.ends_with(" array");
  if (is_array) type.resize(type.size() - 6);
  const auto known = std::ranges::find(kTypes, type, [](const auto& pair) { return pair.first; });
  if (known == kTypes.end())
    return leave_out(row, "a config has no type \"" + std::string(cell(row, "Data Type")) + "\"");
  const Place place = place_of(cell(row, "Address"), type == "string");
  if (place.address.empty()) return leave_out(row, "it has no address");

  ImportedTag tag{row.line, {}};
  const auto before = out_.notes.size();
  tag.keys["address"] = literal(place.address);
  if (!known->second.empty()) tag.keys["type"] = known->second;
  if (place.count) tag.keys["count"] = *place.count;
  if (is_array && !place.count) return leave_out(row, "its array has no length");
  if (place.length) tag.keys["length"] = *place.length;
  if (!place.word_order.empty()) tag.keys["word_order"] = place.word_order;
  if (!add_scaling(row, tag)) return out_.notes.resize(before + 1);
  const std::string rights = lower(cell(row, "Client Access"));
  if (rights == "r/w" || rights == "rw" || rights == "wo" || rights == "w")
    tag.keys["access"] = "read_write";
  if (rights == "wo" || rights == "w")
    out_.note(row.line, "not imported: write only; a tag can always be read");
  add_limits(row, tag);
  if (const auto rate = number_from<std::int64_t>(cell(row, "Scan Rate")))
    tag.keys["group"] = groups_.at(*rate);
  if (!cell(row, "Eng Units").empty()) tag.keys["unit"] = literal(cell(row, "Eng Units"));
  describe(tag, cell(row, "Description"));
  tag.keys["name"] = names_.make(name, "tag", row.line, out_.notes);
  tag.is_changed = out_.notes.size() > before;
  device_.tags.push_back(std::move(tag));
}

}  // namespace

bool is_kepware(std::string_view text) {
  return text.starts_with("Tag Name,Address,") || text.starts_with("Tag Name;Address;") ||
         text.starts_with("\"Tag Name\",");
}

ImportResult import_kepware(std::string_view text, const ImportOptions& options) {
  const auto rows = read_csv(text);
  if (!rows) return tl::unexpected(rows.error());
  if (rows->empty()) return tl::unexpected(ImportFault{0, "has no rows"});
  const CsvRow& head = rows->front();
  if (!has_columns(*rows, {"Tag Name", "Address"}))
    return tl::unexpected(ImportFault{head.line, "has no columns \"Tag Name\" and \"Address\""});

  const std::size_t address = csv_column(head, "Address");
  const auto numeric = std::ranges::count_if(rows->begin() + 1, rows->end(), [&](const auto& row) {
    return begins_with_digit(row.at(address));
  });
  const bool is_modbus = 2 * static_cast<std::size_t>(numeric) > rows->size() - 1;
  Imported out;
  LinkTable links(out);
  ImportedDevice& device =
      add_device(out, links, options, options.device.empty() ? "device1" : options.device,
                 is_modbus ? "modbus-tcp" : "fx-programming-port");
  TagReader reader(out, device, head);
  for (auto row = rows->begin() + 1; row != rows->end(); ++row) reader.take(*row);
  if (is_modbus)
    out.note(0,
             "unit and byte order of the device are not in the file: check \"unit\" and "
             "\"byte_order\"");
  return out;
}

}  // namespace fxagent
