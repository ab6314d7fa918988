// This process and its machine: facts, resources, and a start of the program anew.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace fxagent {

struct ProcessFacts {
  /// The kernel's clock is disciplined (NTP, PTP); false if unknown.
  bool clock_synchronised = false;
  std::uint64_t rss_bytes = 0;  ///< resident memory; 0 if unknown
};
/// Reads adjtimex(2) and /proc/self/statm, for the health message. Any thread.
ProcessFacts read_process_facts();

/// Looks up a variable in the environment of the process.
std::optional<std::string> process_environment(std::string_view name);

/// Returns the machine's boot id, new at each boot; empty if unknown. Reads /proc. Any thread.
std::string boot_id();

// ---- resources that the agent needs before it begins, or before a new config. Without them it
// would hang inside a library and report nothing

/// Checks if `threads` threads can exist at the same time, and `bytes` of address space in addition
/// to their stacks. Returns an empty text, or what is missing and which limit to raise. The threads
/// have ended when it returns.
std::string lacks(int threads, std::size_t bytes);

/// Raises the limit of open files as far as this process may. If it stays at `least` or below,
/// throws std::runtime_error, whose text names the limit to raise.
void raise_file_limit(std::size_t least);

/// Logs an error if fewer than `needed` open files are allowed, with the cure. Links beyond the
/// limit stay down, and each reports only its own failure. Call once per config.
void check_file_limit(std::size_t needed);

// ---- restart

/// Replaces the program by a fresh copy of itself with the same arguments. Closes every file except
/// stdin, stdout and stderr. Ends the process if that fails; its service manager restarts it.
[[noreturn]] void restart_program();
/// True in a program that restart_program() has begun.
bool was_restarted();

}  // namespace fxagent
