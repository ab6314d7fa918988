// Device comments of GX Developer, GX Works2 and GX Works3. The header has the device, then label
// and comment, or one comment for each language. GX Developer writes Shift-JIS and commas, the
// others UTF-16 and tabs. Lines with the project name may precede the header.
#include <algorithm>
#include <array>
#include <string>

#include "agent/config/keys.h"
#include "agent/import/csv.h"
#include "agent/import/formats.h"
#include "agent/text/text.h"
#include "protocol/letter_case.h"

namespace fxagent {
namespace {

using std::string_view_literals::operator""sv;

constexpr std::array kDevice{"Device Name"sv, "Device"sv,   "Device No."sv, "デバイス名"sv,
                             "デバイス"sv,    "软元件名"sv, "软元件"sv};
constexpr std::array kLabel{"Label"sv, "Alias"sv, "ラベル"sv, "別名"sv, "エイリアス"sv};

/// True for "X0", "CN200", "D100.F": letters, then digits of any base.
bool is_device(std::string_view cell) {
  const std::size_t letters = cell.find_first_not_of("ABCDEFGHIJKLMNOPQRSTUVWXYZ");
  return letters >= 1 && letters <= 3 && cell[letters] >= '0' && cell[letters] <= '9' &&
         cell.find_first_not_of("0123456789ABCDEF.", letters) == cell.npos;
}

/// True for the header row. An address column would mean another format.
bool is_head(const CsvRow& row) {
  return contains(kDevice, row.at(0)) && csv_column(row, "address") == std::string::npos;
}

/// Returns the comment of a device, else its label. Comments are in the columns that are not
/// labels.
std::string_view comment_of(const CsvRow& row, const CsvRow* head) {
  std::string_view label;
  for (std::size_t i = 1; i < row.cells.size(); ++i) {
    const std::string_view cell = row.at(i);
    if (cell.empty()) continue;
    if (head == nullptr || !contains(kLabel, head->at(i))) return cell;
    if (label.empty()) label = cell;
  }
  return label;
}

/// Returns the name for a device without a comment: "d100_3" for D100.3.
std::string name_of(std::string_view address) {
  std::string name = lower(address);
  std::ranges::replace(name, '.', '_');
  return name;
}

}  // namespace

bool is_gx_comments(std::string_view text) {
  const auto rows = read_csv(text);
  return rows && std::ranges::any_of(*rows, is_head);
}

ImportResult import_gx_comments(std::string_view text, const ImportOptions& options) {
  const auto rows = read_csv(text);
  if (!rows) return tl::unexpected(rows.error());
  const auto head = std::ranges::find_if(*rows, is_head);
  auto row = head == rows->end() ? rows->begin() : head + 1;

  Imported out;
  std::vector<ImportedTag> tags;
  NameMaker names;
  std::size_t without_comment = 0;
  for (; row != rows->end(); ++row) {
    const std::string_view address = row->at(0);
    if (!is_device(address)) {
      if (head != rows->end() && !address.empty())
        out.leave_out(row->line, "\"" + std::string(address) + "\" is not a device");
      continue;
    }
    const std::string_view comment = comment_of(*row, head == rows->end() ? nullptr : &*head);
    if (comment.empty()) {
      ++without_comment;
      continue;
    }
    ImportedTag tag{row->line, {}};
    const std::size_t before = out.notes.size();
    tag.keys["name"] = names.make(comment, name_of(address), row->line, out.notes);
    tag.is_changed = out.notes.size() > before;
    tag.keys["address"] = literal(address);
    describe(tag, comment);
    tags.push_back(std::move(tag));
  }
  if (head == rows->end() && tags.empty())
    return tl::unexpected(ImportFault{0, "has no device comments"});
  if (without_comment > 0)
    out.note(0, "left out: " + counted(without_comment, "device") + " without a comment");
  LinkTable links(out);
  add_device(out, links, options, options.device.empty() ? "plc1" : options.device,
             "fx-programming-port")
      .tags = std::move(tags);
  return out;
}

}  // namespace fxagent
