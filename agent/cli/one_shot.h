// `fxagent read`, `write`, `force-on`, `force-off`: one command straight to a device, by the same
// admission and on the same bus discipline as the agent's own, without a broker.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "agent/config/config.h"
#include "agent/messages.h"

namespace fxagent {

struct OneShot {
  Op op = Op::read;
  std::string device;
  /// Addresses, or names of the device's tags. Op read: none for all tags; else one.
  std::vector<std::string> names{};
  std::optional<std::string> value;  ///< op write: a JSON value, or plain text for a string
  std::optional<std::string> type;   ///< a word of DataType
  std::uint16_t count = 0;           ///< op read: devices in a row; 0: one
  /// Op read and write: in place of the order that config or protocol say; a word of ByteOrder.
  std::optional<std::string> word_order{};
  bool orders = false;  ///< op read: show the value in every word order
  bool trace = false;   ///< log every frame of its link
  bool as_json = false;
};

/// Carries it out and prints the outcome on stdout. Exit status: 0 done, 1 the device said no or
/// nothing, 2 the question was wrong.
int run_one_shot(Config config, const OneShot& what);

}  // namespace fxagent
