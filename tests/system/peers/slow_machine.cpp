// A slow machine for one program: when preloaded, it delays some calls by a minute. SLOW_SYNC names
// a file: while it exists, syncing to disk is slow, and a file with `.rests` at its end shows that
// a thread waits. SLOW_OPEN names a path that opens slowly, SLOW_LOOKUP a host whose lookup is
// slow.

#include <dlfcn.h>
#include <fcntl.h>
#include <netdb.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cstdarg>
#include <cstdlib>
#include <cstring>
#include <string>

namespace {

constexpr unsigned kSeconds = 60;

void rest_while_syncing() {
  const char* path = std::getenv("SLOW_SYNC");
  if (path == nullptr || access(path, F_OK) != 0) return;
  mknod((std::string(path) + ".rests").c_str(), S_IFREG | 0600, 0);
  for (unsigned i = 0; i < 100 * kSeconds && access(path, F_OK) == 0; ++i) usleep(10'000);
}

int slow_open(const char* path, int flags, mode_t mode) {
  const char* slow = std::getenv("SLOW_OPEN");
  if (slow != nullptr && std::strcmp(slow, path) == 0) sleep(kSeconds);
  return static_cast<int>(syscall(SYS_openat, AT_FDCWD, path, flags, mode));
}

mode_t mode_of(int flags, std::va_list arguments) {
  const bool given = (flags & (O_CREAT | O_TMPFILE)) != 0;
  return given ? static_cast<mode_t>(va_arg(arguments, int)) : mode_t{0};
}

}  // namespace

extern "C" {

int open(const char* path, int flags, ...) {
  std::va_list arguments;
  va_start(arguments, flags);
  const mode_t mode = mode_of(flags, arguments);
  va_end(arguments);
  return slow_open(path, flags, mode);
}

int open64(const char* path, int flags, ...) {
  std::va_list arguments;
  va_start(arguments, flags);
  const mode_t mode = mode_of(flags, arguments);
  va_end(arguments);
  return slow_open(path, flags, mode);
}

int fsync(int file) {
  rest_while_syncing();
  return static_cast<int>(syscall(SYS_fsync, file));
}

int fdatasync(int file) {
  rest_while_syncing();
  return static_cast<int>(syscall(SYS_fdatasync, file));
}

int getaddrinfo(const char* node, const char* service, const addrinfo* hints, addrinfo** found) {
  const char* slow = std::getenv("SLOW_LOOKUP");
  if (slow != nullptr && node != nullptr && std::strcmp(slow, node) == 0) sleep(kSeconds);
  using Real = int (*)(const char*, const char*, const addrinfo*, addrinfo**);
  static const auto real = reinterpret_cast<Real>(dlsym(RTLD_NEXT, "getaddrinfo"));
  return real(node, service, hints, found);
}
}
