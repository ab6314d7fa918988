// Why a serial port cannot be had, and what to do about it. Any thread.
#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace fxagent {

/// A process that has a port open.
struct PortHolder {
  int pid = 0;
  std::string program;  ///< "picocom"
};

/// Another process than this one that has the file open, as far as this user may see it: by
/// /proc/locks, and by /proc/*/fd where that does not tell. Takes some ms; opens nothing.
std::optional<PortHolder> port_holder(const std::string& path);

/// Whether the process was called with the file as an argument, under whatever name. False where
/// this user may not see it.
bool is_called_with(int pid, const std::string& path);

/// Returns another process of this name whose arguments are, among others, `word` and the file at
/// `path`, under whatever name; nullopt: this user sees none.
std::optional<PortHolder> process_called_with(std::string_view program, std::string_view word,
                                              const std::string& path);

/// What to do where opening or locking `path` has failed with this errno, in brackets with a blank
/// before them; empty: nothing is known. May look for the port_holder().
std::string port_cure(const std::string& path, int error);

}  // namespace fxagent
