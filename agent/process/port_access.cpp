#include "agent/process/port_access.h"

#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <climits>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string_view>
#include <vector>

#include "agent/text/text.h"

namespace fxagent {
namespace {

// Limit of open files that are examined, over all processes.
constexpr int kMostFiles = 5000;

/// Returns the entries that are numbers; none if this user may not see the directory.
std::vector<int> numbers_in(const std::string& directory) {
  std::vector<int> numbers;
  std::error_code unseen;
  std::filesystem::directory_iterator entry(directory, unseen);
  for (; entry != std::filesystem::directory_iterator(); entry.increment(unseen))
    if (const auto number = number_from<int>(entry->path().filename().native()))
      numbers.push_back(*number);
  return numbers;
}

std::string program_of(int pid) {
  std::ifstream file("/proc/" + std::to_string(pid) + "/comm");
  std::string name;
  std::getline(file, name);
  return name;
}

/// Returns the command line; empty: this user may not see it.
std::vector<std::string> arguments_of(int pid) {
  std::ifstream file("/proc/" + std::to_string(pid) + "/cmdline", std::ios::binary);
  std::vector<std::string> arguments;
  for (std::string argument; std::getline(file, argument, '\0');) arguments.push_back(argument);
  return arguments;
}

/// Returns the plain files that these arguments of the process name, whatever its directory.
std::vector<std::string> files_named_by(int pid, const std::vector<std::string>& arguments) {
  const std::filesystem::path directory("/proc/" + std::to_string(pid) + "/cwd");
  std::vector<std::string> files;
  for (const std::string& argument : arguments) {
    const auto file = directory / argument;
    std::error_code unseen;
    if (std::filesystem::is_regular_file(file, unseen)) files.push_back(file);
  }
  return files;
}

/// Searches the open files of processes; only root sees those of other users. Skips the maker of a
/// pseudo-terminal, such as a simulator, because it has both ends open.
std::optional<int> holder_by_files(const std::string& real_path) {
  int files = 0;
  for (const int pid : numbers_in("/proc")) {
    if (pid == ::getpid()) continue;
    const std::string open_files = "/proc/" + std::to_string(pid) + "/fd";
    bool has_it = false;
    bool is_maker = false;
    for (const int file : numbers_in(open_files)) {
      if (++files > kMostFiles) return std::nullopt;
      std::error_code unseen;
      const auto target =
          std::filesystem::read_symlink(open_files + "/" + std::to_string(file), unseen);
      has_it |= target == real_path;
      is_maker |= target == "/dev/ptmx" || target == "/dev/pts/ptmx";
    }
    if (has_it && !(is_maker && real_path.starts_with("/dev/pts/"))) return pid;
  }
  return std::nullopt;
}

/// Searches the locks, which every user may see: "1: FLOCK  ADVISORY  WRITE 4711 00:06:123 0 EOF".
/// The holder may be this process.
std::optional<int> holder_by_lock(const struct stat& file) {
  std::array<char, 64> wanted{};
  std::snprintf(wanted.data(), wanted.size(), "%02x:%02x:%lu", major(file.st_dev),
                minor(file.st_dev), static_cast<unsigned long>(file.st_ino));
  std::ifstream locks("/proc/locks");
  std::string line;
  while (std::getline(locks, line)) {
    std::istringstream words(line);
    std::string number;
    std::string kind;
    std::string advice;
    std::string access;
    std::string place;
    int pid = 0;
    words >> number >> kind;
    if (kind == "->") continue;  // a process that waits for the lock above
    words >> advice >> access >> pid >> place;
    if (place == wanted.data() && pid > 0) return pid;
  }
  return std::nullopt;
}

/// Returns the name with this number in /etc/group or /etc/passwd, whose lines begin with name,
/// password and number; nullopt if there is none. Only files of this machine are read: a directory
/// service would be queried on a thread that polls, and may take long to answer; the groups of
/// ports are local.
std::optional<std::string> name_in(const char* path, std::uint32_t number) {
  std::ifstream file(path);
  for (std::string line; std::getline(file, line);) {
    std::string_view rest = line;
    const std::string_view name = take_until(rest, ':');
    take_until(rest, ':');
    if (number_from<std::uint32_t>(take_until(rest, ':')) == number) return std::string(name);
  }
  return std::nullopt;
}

bool is_in(gid_t group) {
  if (::getegid() == group) return true;
  std::vector<gid_t> groups(static_cast<std::size_t>(std::max(0, ::getgroups(0, nullptr))));
  const int count = ::getgroups(static_cast<int>(groups.size()), groups.data());
  groups.resize(static_cast<std::size_t>(std::max(0, count)));
  return std::ranges::find(groups, group) != groups.end();
}

std::string no_permission(const std::string& path) {
  struct stat file {};
  constexpr mode_t kGroupMay = S_IRGRP | S_IWGRP;
  if (::stat(path.c_str(), &file) != 0) return " (this user may not enter a directory of the path)";
  const std::string group =
      name_in("/etc/group", file.st_gid).value_or(std::to_string(file.st_gid));
  if ((file.st_mode & kGroupMay) != kGroupMay || file.st_gid == 0)
    return " (its group may not open it: set group and mode by a udev rule, GROUP=\"dialout\", "
           "MODE=\"0660\")";
  if (is_in(file.st_gid))
    return " (the group " + group +
           " may open it, and this user is in it: look for another cause, such as AppArmor or the "
           "container)";
  return " (it belongs to the group " + group + ": usermod -aG " + group + " " +
         name_in("/etc/passwd", ::geteuid()).value_or("USER") +
         ", then log in again; for a service SupplementaryGroups=" + group +
         ", for a container --group-add " + std::to_string(file.st_gid) + ")";
}

/// Returns the node by which this process has locked the device of `path`; empty: it has not. A
/// device may have several nodes, and a lock holds for one of them.
std::string node_locked_here(const std::string& path) {
  struct stat port {};
  if (::stat(path.c_str(), &port) != 0) return {};
  const std::filesystem::path open_files("/proc/self/fd");
  for (const int number : numbers_in(open_files)) {
    struct stat file {};
    const bool is_device =
        ::fstat(number, &file) == 0 && S_ISCHR(file.st_mode) && file.st_rdev == port.st_rdev;
    std::error_code unseen;
    if (is_device && holder_by_lock(file) == ::getpid())
      return std::filesystem::read_symlink(open_files / std::to_string(number), unseen);
  }
  return {};
}

std::string in_use(const std::string& path) {
  if (const std::string node = node_locked_here(path); !node.empty())
    return " (another link of this agent uses this device, as " + node +
           ": put the devices of both on one link)";
  if (const auto holder = port_holder(path))
    return " (another program uses it: " + holder->text() + "; end it, or use another port)";
  return " (another program uses it, such as GX Works or another agent: as root, fuser -v " + path +
         " names it; end it, or use another port)";
}

}  // namespace

bool is_no_port(const std::string& path) {
  constexpr unsigned kMemoryDevices = 1;  // /dev/null and its like
  struct stat file {};
  return ::stat(path.c_str(), &file) == 0 &&
         (!S_ISCHR(file.st_mode) || major(file.st_rdev) == kMemoryDevices);
}

std::optional<FileHolder> file_holder(const std::string& path) {
  struct stat file {};
  std::array<char, PATH_MAX> real{};
  if (::stat(path.c_str(), &file) != 0 || ::realpath(path.c_str(), real.data()) == nullptr)
    return std::nullopt;
  auto pid = holder_by_lock(file);
  if (!pid || pid == ::getpid()) pid = holder_by_files(real.data());
  if (!pid) return std::nullopt;
  return FileHolder{*pid, program_of(*pid)};
}

std::optional<FileHolder> port_holder(const std::string& path) {
  return is_no_port(path) ? std::nullopt : file_holder(path);
}

bool is_called_with(int pid, const std::string& path) {
  std::error_code unseen;
  return std::ranges::any_of(files_named_by(pid, arguments_of(pid)), [&](const std::string& file) {
    return std::filesystem::equivalent(file, path, unseen);
  });
}

std::vector<CalledProcess> processes_called(std::string_view program, std::string_view word) {
  std::vector<CalledProcess> found;
  for (const int pid : numbers_in("/proc")) {
    if (pid == ::getpid() || program_of(pid) != program) continue;
    const auto arguments = arguments_of(pid);
    if (std::ranges::count(arguments, word) > 0)
      found.push_back({pid, files_named_by(pid, arguments)});
  }
  return found;
}

std::string port_cure(const std::string& path, int error) {
  switch (error) {
    case ENOENT:
    case ENODEV:
    case ENXIO:
      return " (is the adapter plugged in? a path under /dev/serial/by-id survives replugging)";
    case EACCES:
      return no_permission(path);
    case EPERM:
      return " (the unit or the container does not allow this device: see DeviceAllow, --device)";
    case ENOTTY:
      return " (a serial port is a tty, such as /dev/ttyUSB0 or one in /dev/serial/by-id: correct "
             "path)";
    case EBUSY:
    case EWOULDBLOCK:
      return in_use(path);
    default:
      return {};
  }
}

}  // namespace fxagent
