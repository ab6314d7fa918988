// The CPU's part in a request of the MC protocol, independent of the frame: limits, ranges, device
// memory, RUN and STOP. A refusal is returned as a reason; the frame type determines its end code.
#pragma once

#include <string>
#include <vector>

#include "tests/sim/mc_message.h"
#include "tests/sim/personality.h"

namespace fxsim {

enum class McRefusal : std::uint8_t {
  none,
  command,     // command or subcommand not supported
  long_codes,  // iQ-R device codes sent to a Q or L module
  length,      // the length does not match the content
  characters,  // ASCII that is not a number
  words,       // number of points
  bits,
  random_words,
  random_bits,
  beyond,     // past the last device
  device,     // unknown device
  unit,       // bit access to a word device, and other bad requests
  way,        // this device needs another command
  bit_value,  // neither 0 nor 1
  write_in_run,
  state,   // not allowed in RUN
  route,   // addressed to another station
  header,  // bad header of a serial frame
  sum,
};
std::string_view refusal_text(McRefusal refusal);

struct McCpuSettings {
  bool serial = false;        // the limits of a serial port
  bool module = false;        // Q and L: accessed through a module, not their own Ethernet port
  bool write_in_run = true;   // accepts writes in RUN
  std::vector<Hole> holes{};  // a request that touches a hole is beyond the last device
  std::string type_name{};    // empty: the model's own name
};

struct McOutcome {
  McRefusal refusal = McRefusal::none;
  Bytes data{};          // of the answer
  std::string device{};  // as in Ruling
  unsigned count = 0;
  unsigned points = 0;  // total, in the request's own unit
  std::vector<std::uint32_t> values{};
};

RequestKind mc_request_kind(const McRequest& request);
McOutcome carry_out_mc(const McRequest& request, McCode code, const McCpuSettings& settings,
                       Plc& plc);
/// True if all devices of the row exist and none lies in a hole.
bool is_there(const DeviceMemory& memory, const std::vector<Hole>& holes, Device first,
              std::uint64_t count);

}  // namespace fxsim
