// Length of the trial of a remote config.
#pragma once

#include <chrono>

namespace fxagent {

/// Returns 60 s in the product. A test program may define its own version: ours is alone in its
/// archive member, so the linker then leaves it out. Any thread.
std::chrono::milliseconds trial_time() noexcept;

}  // namespace fxagent
