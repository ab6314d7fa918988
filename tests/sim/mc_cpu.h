// What a CPU does with a request of the MC protocol, whatever frame brought it: limits, ranges,
// device memory, RUN and STOP. It refuses with a reason; which end code that is depends on the
// frame.
#pragma once

#include <string>
#include <vector>

#include "tests/sim/mc_message.h"
#include "tests/sim/personality.h"

namespace fxsim {

enum class McRefusal : std::uint8_t {
  none,
  command,     // command or subcommand not supported
  long_codes,  // codes of iQ-R at a Q or L module
  length,      // the length does not fit the content
  characters,  // ASCII that is no number
  words,       // number of points
  bits,
  random_words,
  random_bits,
  beyond,     // past the last device
  device,     // no such device
  unit,       // points of a word device, and other bad requests
  way,        // this device only by other commands
  bit_value,  // neither 0 nor 1
  write_in_run,
  state,   // not while in RUN
  route,   // for another station
  header,  // of a serial frame
  sum,
};
std::string_view refusal_text(McRefusal refusal);

struct McCpuSettings {
  bool serial = false;        // the limits of a serial port
  bool module = false;        // Q and L: asked through a module, not their own Ethernet port
  bool write_in_run = true;   // writes are taken in RUN too
  std::vector<Hole> holes{};  // a request that touches one is beyond the last device
  std::string type_name{};    // empty: the model's own
};

struct McOutcome {
  McRefusal refusal = McRefusal::none;
  Bytes data{};          // of the answer
  std::string device{};  // as in Ruling
  unsigned count = 0;
  unsigned points = 0;  // in the request's own unit, all together
  std::vector<std::uint32_t> values{};
};

RequestKind mc_request_kind(const McRequest& request);
McOutcome carry_out_mc(const McRequest& request, McCode code, const McCpuSettings& settings,
                       Plc& plc);
/// Does a row of devices exist, without a hole in it?
bool is_there(const DeviceMemory& memory, const std::vector<Hole>& holes, Device first,
              std::uint64_t count);

}  // namespace fxsim
