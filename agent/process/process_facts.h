// Facts from the operating system about this process and its clock, for the health message.
#pragma once

#include <cstdint>
#include <string>

namespace fxagent {

struct ProcessFacts {
  bool clock_synchronised =
      false;                    ///< the kernel's clock is disciplined (NTP, PTP); false if unknown
  std::uint64_t rss_bytes = 0;  ///< resident memory; 0 if unknown
};

/// Returns the machine's boot id, which differs after each boot; empty if unknown. Reads /proc. Any
/// thread.
std::string boot_id();

/// Reads adjtimex(2) and /proc/self/statm. Any thread.
ProcessFacts read_process_facts();

}  // namespace fxagent
