// `fxagent read`, `write`, `force-on`, `force-off`: sends one command directly to a device, with
// the admission and bus discipline of the agent but without a broker.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "agent/config/model.h"
#include "agent/handover/command_message.h"

namespace fxagent {

struct OneShot {
  Op op = Op::read;
  std::string device;
  /// Addresses or tag names. Op read: empty means all tags. Other ops: exactly one.
  std::vector<std::string> names{};
  std::optional<std::string> value;  ///< op write: a JSON value, or plain text for a string
  std::optional<std::string> type;   ///< a word of DataType
  std::uint16_t count = 0;           ///< op read: number of consecutive devices; 0 means one
  /// Op read and write: overrides the order from config or protocol; a word of ByteOrder.
  std::optional<std::string> word_order{};
  bool orders = false;  ///< op read: show the value in every word order
  bool trace = false;   ///< log every frame of the link
  bool as_json = false;
};

/// Executes the command and prints the outcome on stdout. Exit status: 0 success; 1 the device
/// refused or did not answer; 2 a wrong argument.
int run_one_shot(Config config, const OneShot& what);

}  // namespace fxagent
