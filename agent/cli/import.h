// `fxagent import` and `fxagent export`: convert files of other programs to configs, and the tags
// of a config to CSV and back.
#pragma once

#include <string>

#include "agent/import/imported.h"

namespace fxagent {

struct ImportQuestion {
  std::string format;  ///< a name from import_formats(), or auto
  std::string path;
  ImportOptions options;
};

/// Prints a config that passes `check`, and on stderr everything in the file that it leaves out.
/// Exit status: 0; 1 if nothing could be converted; 2 if an argument is wrong or the file cannot be
/// read.
int run_import(const ImportQuestion& what);

/// Prints the tags of a config file that has passed `check`. Exit status: 0, or 2 if the file can
/// no longer be read.
int run_export(const std::string& path);

}  // namespace fxagent
