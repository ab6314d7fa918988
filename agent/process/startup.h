// Resources that the agent needs before it begins, or before a new config: threads, memory and open
// files. Without them it would hang inside a library and report nothing.
#pragma once

#include <cstddef>
#include <string>

namespace fxagent {

/// Checks if `threads` threads can exist at the same time, and `bytes` of address space in addition
/// to their stacks. Returns an empty text, or what is missing and which limit to raise. The threads
/// have ended when it returns.
std::string lacks(int threads, std::size_t bytes);

/// Raises the limit of open files as far as this process may. If it stays at `least` or below,
/// throws std::runtime_error, whose text names the limit to raise.
void raise_file_limit(std::size_t least);

/// Logs an error if fewer than `needed` open files are allowed, with the cure. Links beyond the
/// limit stay down, and each reports only its own failure. Call once per config.
void say_where_files_are_too_few(std::size_t needed);

}  // namespace fxagent
