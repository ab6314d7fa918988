#include "agent/log/journal_stream.h"

#include <sys/stat.h>

#include <cstdlib>
#include <string>

namespace fxagent::log {

bool is_journal_stream(int handle) {
  // The environment does not change while the agent runs.
  const char* named = std::getenv("JOURNAL_STREAM");  // NOLINT(concurrency-mt-unsafe)
  struct stat file {};
  if (named == nullptr || ::fstat(handle, &file) != 0) return false;
  return named == std::to_string(file.st_dev) + ":" + std::to_string(file.st_ino);
}

}  // namespace fxagent::log
