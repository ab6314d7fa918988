// Resources that the agent needs before it begins: threads, memory and open files. Without them it
// would hang inside a library and report nothing.
#pragma once

#include <cstddef>
#include <string>

namespace fxagent {

/// Checks if `threads` threads can exist at the same time, and `bytes` of address space in addition
/// to their stacks. Returns an empty text, or what is missing and which limit to raise. The threads
/// have ended when it returns.
std::string lacks(int threads, std::size_t bytes);

}  // namespace fxagent
