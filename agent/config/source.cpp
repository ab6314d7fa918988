#include "agent/config/source.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <string>
#include <system_error>
#include <utility>

#include "agent/config/json/tree.h"
#include "agent/file_handle.h"

namespace fxagent {
namespace {

using Clock = std::chrono::steady_clock;

/// Time limit for pipes and devices, as in `check <(jq . agent.json)`.
constexpr std::chrono::seconds kPipeReads{5};

/// Waits until there is data or the end of the file. False if `deadline` passes first.
bool await_bytes(int file, Clock::time_point deadline) {
  using std::chrono::milliseconds;
  while (true) {
    const auto left = std::chrono::ceil<milliseconds>(deadline - Clock::now());
    pollfd wanted{file, POLLIN, 0};
    const int found = ::poll(&wanted, 1, static_cast<int>(std::max(left, milliseconds(0)).count()));
    if (found > 0) return true;
    if (found == 0 || errno != EINTR) return false;
  }
}

}  // namespace

FilePrivacy privacy_of(const std::string& path) {
  struct stat file {};
  const bool is_own = ::stat(path.c_str(), &file) == 0 && S_ISREG(file.st_mode) &&
                      (file.st_mode & (S_IRWXG | S_IRWXO)) == 0;
  return is_own ? FilePrivacy::owner_only : FilePrivacy::shared;
}

// If the path is a pipe without a writer, reading must end all the same: it must not block the
// reload thread.
tl::expected<std::string, ConfigErrors> read_config_file(const std::string& path) {
  const auto unreadable = [](std::string why) {
    return tl::unexpected(ConfigErrors{ConfigError{"", 0, "cannot be read: " + std::move(why)}});
  };
  const auto system_fault = [] { return std::generic_category().message(errno); };
  // Without O_NONBLOCK, open() of a named pipe without a writer would block.
  const FileHandle file(::open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC | O_NOCTTY));
  struct stat kind {};
  if (file < 0 || ::fstat(file, &kind) != 0) return unreadable(system_fault());
  if (S_ISDIR(kind.st_mode)) return unreadable("it is a directory");
  const auto deadline = Clock::now() + kPipeReads;
  // Stops an endless file: one byte over the limit is enough for the parser to reject the text.
  std::string text;
  std::array<char, 65536> block{};
  while (text.size() <= ConfigTree::max_bytes) {
    const auto got = ::read(file, block.data(), block.size());
    if (got > 0) {
      text.append(block.data(), static_cast<std::size_t>(got));
      continue;
    }
    if (got == 0 && text.empty() && S_ISFIFO(kind.st_mode))
      return unreadable("it is a pipe that no program writes to");
    if (got == 0) break;
    if (errno == EINTR) continue;
    if (errno != EAGAIN) return unreadable(system_fault());
    if (!await_bytes(file, deadline))
      return unreadable("it is not a regular file, and it did not end within " +
                        std::to_string(kPipeReads.count()) + " s");
  }
  return text;
}

}  // namespace fxagent
