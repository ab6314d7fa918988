// `fxagent record`: asks the running agent for recordings.
// `fxagent replay`: explains the frames of a recording.
#pragma once

#include <string>
#include <vector>

#include "agent/config/model.h"

namespace fxagent {

struct RecordQuestion {
  std::vector<std::string> links;  ///< by name; empty: all
};
/// Prints the path of each recording. Returns kWrong if the config has no recorder or no such link,
/// kFailed if no agent answers.
int run_record(const Config& config, const RecordQuestion& question);

struct ReplayQuestion {
  std::string path;
  std::string pcapng;  ///< file to write; empty: print the frames
  bool as_json = false;
};
/// Returns kWrong if the file is not a recording, kFailed if the capture cannot be written.
int run_replay(const ReplayQuestion& question);

}  // namespace fxagent
