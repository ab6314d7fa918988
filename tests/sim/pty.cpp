#include "tests/sim/pty.h"

#include <fcntl.h>
#include <stdlib.h>
#include <sys/inotify.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <system_error>

namespace fxsim {
namespace {

int checked(int result, const std::string& what) {
  if (result < 0) throw std::system_error(errno, std::generic_category(), what);
  return result;
}

}  // namespace

Pty::Pty(std::string link) : link_(std::move(link)) {
  namespace fs = std::filesystem;
  try {
    master_ = checked(::posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC), "no pseudo terminal");
    checked(::grantpt(master_), "grantpt");
    checked(::unlockpt(master_), "unlockpt");
    std::array<char, 128> name{};
    const int error = ::ptsname_r(master_, name.data(), name.size());
    if (error != 0) throw std::system_error(error, std::generic_category(), "ptsname");
    device_ = name.data();
    slave_ = checked(::open(device_.c_str(), O_RDWR | O_NOCTTY | O_CLOEXEC), device_);
    termios settings{};
    checked(::tcgetattr(slave_, &settings), device_);
    ::cfmakeraw(&settings);
    checked(::tcsetattr(slave_, TCSANOW, &settings), device_);
    watch_ = checked(::inotify_init1(IN_NONBLOCK | IN_CLOEXEC), "inotify");
    checked(::inotify_add_watch(watch_, device_.c_str(), IN_CLOSE), device_);

    const auto status = fs::symlink_status(link_);
    if (fs::exists(status) && !fs::is_symlink(status))
      throw std::system_error(EEXIST, std::generic_category(), link_ + " is not a link");
    // Renames the new link over the old one in one step, so that the name always exists.
    const auto fresh = link_ + ".new";
    fs::remove(fresh);
    fs::create_symlink(device_, fresh);
    fs::rename(fresh, link_);
  } catch (...) {
    close_all();
    throw;
  }
}

Pty::~Pty() {
  std::error_code ignored;
  if (std::filesystem::read_symlink(link_, ignored) == device_)
    std::filesystem::remove(link_, ignored);
  close_all();
}

void Pty::close_all() noexcept {
  for (const int fd : {master_, slave_, watch_})
    if (fd >= 0) ::close(fd);
}

void Pty::notice_closing() {
  alignas(inotify_event) std::array<char, 1024> events{};
  bool closed = false;
  while (::read(watch_, events.data(), events.size()) > 0) closed = true;
  if (!closed) return;
  ::ioctl(slave_, TIOCNXCL);
  ::tcflush(slave_, TCIFLUSH);
}

}  // namespace fxsim
