#include "agent/process/process_facts.h"

#include <sys/timex.h>
#include <unistd.h>

#include <fstream>

namespace fxagent {

std::string boot_id() {
  std::string id;
  std::getline(std::ifstream("/proc/sys/kernel/random/boot_id"), id);
  return id;
}

ProcessFacts read_process_facts() {
  ProcessFacts facts;
  timex clock{};
  const int state = adjtimex(&clock);
  facts.clock_synchronised = state >= 0 && state != TIME_ERROR && (clock.status & STA_UNSYNC) == 0;
  std::ifstream statm("/proc/self/statm");
  std::uint64_t total_pages = 0;
  std::uint64_t resident_pages = 0;
  if (statm >> total_pages >> resident_pages)
    facts.rss_bytes = resident_pages * static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE));
  return facts;
}

}  // namespace fxagent
