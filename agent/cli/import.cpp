#include "agent/cli/subcommands.h"

#include <algorithm>
#include <iostream>
#include <string_view>
#include <vector>

#include "agent/cli/exit_status.h"
#include "agent/config/model.h"
#include "agent/config/source.h"
#include "agent/config/suggestions.h"
#include "agent/import/formats.h"
#include "agent/text/text.h"
#include "protocol/catalog.h"

namespace fxagent {
namespace {

std::string place(const std::string& path, int line) {
  return line > 0 ? path + ":" + std::to_string(line) : path;
}

/// Returns the fault in the options; empty if there is none.
std::string fault_of(const ImportOptions& options) {
  if (!options.protocol.empty() && find_protocol(options.protocol) == nullptr)
    return "there is no protocol " + shown(options.protocol) +
           did_you_mean(options.protocol, names_in(catalog()));
  if (!options.port.empty() && !LinkTable::is_serial(options.port))
    return "--port must be a serial port such as /dev/ttyUSB0, or host:port";
  if (!options.device.empty() && !is_name(options.device))
    return "--device: a name is 1 to 64 of a-z, 0-9, _ and -";
  return {};
}

/// Returns the format with that name; for auto, the format that recognises the bytes.
const ImportFormat* format_of(const std::string& name, const std::string& bytes) {
  for (const ImportFormat& format : import_formats()) {
    if (name != "auto") {
      if (format.name == name) return &format;
      continue;
    }
    const auto text = to_utf8(bytes, format.legacy);
    if (text && format.is_it(*text)) return &format;
  }
  return nullptr;
}

}  // namespace

int run_import(const ImportQuestion& what) {
  auto names = names_in(import_formats());
  names.insert(names.begin(), "auto");
  if (std::ranges::find(names, what.format) == names.end())
    return refused("import", "there is no format " + shown(what.format) +
                                 did_you_mean(what.format, names) + "; the formats are " +
                                 joined(names, ", ") + ", and a spreadsheet must be saved as CSV");
  if (const std::string fault = fault_of(what.options); !fault.empty())
    return refused("import", fault);
  const auto bytes = read_config_file(what.path);
  if (!bytes) return refused("import", to_string(bytes.error().front(), what.path));
  if (bytes->starts_with("PK\x03\x04"))
    return refused("import",
                   what.path +
                       ": is a zip file, perhaps a workbook (.xlsx): save its sheet as CSV, with a "
                       "spreadsheet program or `xlsx2csv`, and import the CSV");
  const ImportFormat* format = format_of(what.format, *bytes);
  if (format == nullptr)
    return refused("import", what.path + ": the format is not recognised; name it: " +
                                 one_of(names_in(import_formats())));
  const auto text = to_utf8(*bytes, format->legacy);
  if (!text) return refused("import", what.path + ": " + text.error());
  if (!is_unicode(*bytes))
    std::cerr << what.path << ": the encoding is not Unicode and assumed to be " << format->legacy
              << ": if letters are wrong, convert the file to UTF-8 first, as with iconv\n";
  auto imported = format->read(*text, what.options);
  if (!imported)
    return refused("import",
                   place(what.path, imported.error().line) + ": " + imported.error().text);

  const ImportOutcome outcome = finish(*std::move(imported));
  for (const ImportNote& note : outcome.notes)
    std::cerr << place(what.path, note.line) << ": " << escaped(note.text, Escape::message) << '\n';
  if (outcome.config.empty())
    return refused(what.path,
                   "nothing was imported, " + counted(outcome.left_out, "tag") + " left out",
                   kFailed);
  std::cerr << what.path << ": " << counted(outcome.tags, "tag") << " imported, " << outcome.changed
            << " of them changed, " << outcome.left_out << " left out\n";
  std::cout << outcome.config;
  return kDone;
}

int run_export(const std::string& path) {
  std::string text;
  if (!loaded(path, &text)) return kWrong;
  std::cout << export_csv(text);
  return kDone;
}

}  // namespace fxagent
