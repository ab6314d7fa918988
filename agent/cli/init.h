// `fxagent init`: the files that a new plant begins with.
#pragma once

#include <string>

#include "agent/cli/init_files.h"

namespace fxagent {

struct InitQuestion {
  std::string directory = ".";
  bool force = false;  ///< overwrite what is there
  InitAnswers answers;
};

/// Asks on a terminal for what the call leaves open, writes the files and creates that of the
/// password; then prints check, plan and the next call. Exit status: 0; 1 where a file is there
/// already or cannot be written; 2 where something is missing and nobody can be asked, or an answer
/// is wrong.
int run_init(InitQuestion what);

}  // namespace fxagent
