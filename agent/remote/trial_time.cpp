#include "agent/remote/remote_config.h"

namespace fxagent {

std::chrono::milliseconds trial_time() noexcept { return std::chrono::seconds(60); }

}  // namespace fxagent
