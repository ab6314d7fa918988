#include "agent/handover/line_permit.h"

#include <ctime>

namespace fxagent {

BootTime boot_time_now() {
  timespec time{};
  clock_gettime(CLOCK_BOOTTIME, &time);
  return std::chrono::seconds(time.tv_sec) + std::chrono::nanoseconds(time.tv_nsec);
}

}  // namespace fxagent
