// Explains why a serial port cannot be opened, and what to do. Finds the process that holds a port
// or another file. Any thread.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace fxagent {

/// A process that has a file open.
struct FileHolder {
  int pid = 0;
  std::string program;  ///< "picocom"

  std::string text() const { return program + ", pid " + std::to_string(pid); }
};

/// True if the path exists and cannot be a serial port: a file, a directory, or a device such as
/// /dev/null. Does not open it.
bool is_no_port(const std::string& path);

/// Returns another process that has the file locked or open, as far as this user may see it: from
/// /proc/locks, and otherwise from /proc/*/fd. Takes some ms; does not open the file.
std::optional<FileHolder> file_holder(const std::string& path);
/// Same for a port. nullopt if is_no_port().
std::optional<FileHolder> port_holder(const std::string& path);

/// True if the file is an argument of the process, under any name. False if this user may not see
/// it.
bool is_called_with(int pid, const std::string& path);

/// A process and the plain files that its arguments name.
struct CalledProcess {
  int pid = 0;
  std::vector<std::string> files;
};

/// Returns the other processes of this name whose arguments include `word`, as far as this user may
/// see them. A relative argument is resolved as that process resolves it.
std::vector<CalledProcess> processes_called(std::string_view program, std::string_view word);

/// Returns advice after opening or locking `path` has failed with this errno, in brackets with a
/// blank before them; empty: none. May call port_holder().
std::string port_cure(const std::string& path, int error);

}  // namespace fxagent
