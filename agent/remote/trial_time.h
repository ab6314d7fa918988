// How long a remote config is on trial.
#pragma once

#include <chrono>

namespace fxagent {

/// 60 s in the product. A test program that defines it by itself is linked with that definition
/// instead: this one stands alone in its archive member. Any thread.
std::chrono::milliseconds trial_time() noexcept;

}  // namespace fxagent
