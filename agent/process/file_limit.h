// How many files and sockets this process may open.
#pragma once

#include <cstddef>

namespace fxagent {

/// Raises the limit as far as this process may. Throws what says why, where no more than `least`
/// are allowed.
void raise_file_limit(std::size_t least);

/// Logs where fewer than `needed` are allowed, and how that is cured: the links beyond stay down,
/// and each says only that for itself. Once for a config.
void say_where_files_are_too_few(std::size_t needed);

}  // namespace fxagent
