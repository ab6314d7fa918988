#include "agent/cli/setup/init_machine.h"

#include <fcntl.h>
#include <pwd.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <fstream>
#include <set>
#include <system_error>

#include "agent/file_handle.h"

namespace fxagent {
namespace {

namespace fs = std::filesystem;

std::vector<fs::path> sorted(const fs::path& directory) {
  std::error_code fault;
  std::vector<fs::path> paths;
  for (fs::directory_iterator it(directory, fault), end; !fault && it != end; it.increment(fault))
    paths.push_back(it->path());
  std::ranges::sort(paths);
  return paths;
}

/// True for a PC port without hardware. Linux has 32 such entries; the type of an unused one is 0.
bool is_empty_place(const fs::path& port) {
  std::ifstream file(port / "type");
  int kind = 1;
  return file >> kind && kind == 0;
}

// Safe: the command line has one thread.
// NOLINTBEGIN(concurrency-mt-unsafe)
std::string name_of(uid_t user) {
  const passwd* entry = ::getpwuid(user);
  return entry == nullptr ? std::to_string(user) : entry->pw_name;
}
const passwd* entry_of(const std::string& user) { return ::getpwnam(user.c_str()); }
// NOLINTEND(concurrency-mt-unsafe)

}  // namespace

std::vector<FoundPort> found_serial_ports(const fs::path& root) {
  std::error_code fault;
  std::vector<FoundPort> ports;
  std::set<std::string> named;
  for (const fs::path& link : sorted(root / "dev/serial/by-id")) {
    const std::string port = fs::canonical(link, fault).filename().string();
    if (fault) continue;
    named.insert(port);
    ports.push_back({"/dev/serial/by-id/" + link.filename().string(), port});
  }
  for (const fs::path& port : sorted(root / "sys/class/tty")) {
    const std::string name = port.filename().string();
    const bool has_hardware = fs::exists(port / "device", fault) && !is_empty_place(port);
    if (has_hardware && !named.contains(name) && fs::exists(root / "dev" / name, fault))
      ports.push_back({"/dev/" + name, {}});
  }
  return ports;
}

tl::expected<PasswordFile, std::string> create_password_file(const std::string& path,
                                                             const std::string& password,
                                                             const std::string& owner) {
  const auto failed = [&path] {
    return tl::unexpected(path + " cannot be created: " + std::generic_category().message(errno));
  };
  const FileHandle file(::open(path.c_str(), O_CREAT | O_EXCL | O_WRONLY | O_CLOEXEC, 0600));
  if (file < 0 && errno == EEXIST) return PasswordFile{};
  if (file < 0) return failed();
  bool done = true;
  if (::geteuid() == 0)
    if (const passwd* entry = entry_of(owner))
      done = ::fchown(file, entry->pw_uid, entry->pw_gid) == 0;
  const std::string text = password.empty() ? password : password + "\n";
  struct stat made {};
  if (done && write_all(file, text) && ::fstat(file, &made) == 0)
    return PasswordFile{true, name_of(made.st_uid)};
  auto fault = failed();
  ::unlink(path.c_str());  // the next call would take it for a whole one
  return fault;
}

}  // namespace fxagent
