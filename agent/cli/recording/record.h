// `fxagent record`: asks the running agent for recordings.
// `fxagent replay`: explains the frames of a recording.
// `fxagent decode`: explains a frame field by field.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "agent/config/model.h"
#include "protocol/codec.h"

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

struct DecodeQuestion {
  std::string protocol;
  std::vector<std::string> hex;  ///< in any spelling that from_hex() reads
  std::string model;             ///< empty: the protocol's widest model
  std::optional<Direction> direction;
  bool as_json = false;
};
/// Prints the explanation on stdout. Exit status: 0 valid frame, 1 invalid frame, 2 wrong argument.
int run_decode(const DecodeQuestion& question);

}  // namespace fxagent
