// `fxagent init`: creates the initial files of a new plant.
#pragma once

#include <string>

#include "agent/cli/setup/init_files.h"

namespace fxagent {

struct InitQuestion {
  std::string directory = ".";
  bool force = false;  ///< overwrite existing files
  InitAnswers answers;
};

/// Prompts on a terminal for missing answers, writes the files and creates the password file; then
/// prints check, plan and the next command. Exit status: 0; 1 if a file exists already or cannot be
/// written; 2 if an answer is wrong, or is missing and stdin is not a terminal.
int run_init(const InitQuestion& question);

}  // namespace fxagent
