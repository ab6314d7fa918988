// `fxagent import` and `fxagent export`: configs out of the files of other programs, and the tags
// of a config as CSV and back.
#pragma once

#include <string>

#include "agent/import/imported.h"

namespace fxagent {

struct ImportQuestion {
  std::string format;  ///< a name of import_formats(), or auto
  std::string path;
  ImportOptions options;
};

/// Prints a config that passes check, and on stderr what of the file is not in it. Exit status: 0;
/// 1 where nothing could be carried over; 2 where the call is wrong or the file cannot be read.
int run_import(const ImportQuestion& what);

/// Prints the tags of the config file, which has been found right. Exit status: 0, or 2 where it
/// cannot be read any more.
int run_export(const std::string& path);

/// The names of all formats, for --help.
std::string import_format_names();

}  // namespace fxagent
