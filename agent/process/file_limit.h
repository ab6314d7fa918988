// Limit of the files and sockets that this process may open.
#pragma once

#include <cstddef>

namespace fxagent {

/// Raises the limit as far as this process may. If it stays at `least` or below, throws
/// std::runtime_error, whose text names the limit to raise.
void raise_file_limit(std::size_t least);

/// Logs an error if fewer than `needed` are allowed, with the cure. Links beyond the limit stay
/// down, and each reports only its own failure. Call once per config.
void say_where_files_are_too_few(std::size_t needed);

}  // namespace fxagent
