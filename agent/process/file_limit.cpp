#include "agent/process/file_limit.h"

#include <sys/resource.h>

#include <stdexcept>
#include <string>

#include "agent/log/log.h"

namespace fxagent {

// A socket for each of 1,000 links is more than Debian's soft limit of 1,024 leaves room for.
void raise_file_limit(std::size_t least) {
  rlimit limit{};
  if (getrlimit(RLIMIT_NOFILE, &limit) != 0) return;
  limit.rlim_cur = limit.rlim_max;
  setrlimit(RLIMIT_NOFILE, &limit);
  if (limit.rlim_max > static_cast<rlim_t>(least)) return;
  throw std::runtime_error("cannot start: " + std::to_string(limit.rlim_max) +
                           " open files are allowed, and the agent needs more than " +
                           std::to_string(least) +
                           "; raise the hard limit (LimitNOFILE of the service, ulimit -Hn)");
}

void say_where_files_are_too_few(std::size_t needed) {
  rlimit limit{};
  if (getrlimit(RLIMIT_NOFILE, &limit) != 0 || limit.rlim_max == RLIM_INFINITY ||
      limit.rlim_max >= static_cast<rlim_t>(needed))
    return;
  log::error("agent", {{"open_files_allowed", std::to_string(limit.rlim_max)},
                       {"open_files_needed", std::to_string(needed)},
                       {"note",
                        "too few open files for all links: raise the hard limit (LimitNOFILE of "
                        "the service, ulimits of a container, ulimit -Hn in a shell)"}});
}

}  // namespace fxagent
