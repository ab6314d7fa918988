#include "agent/failpoint.h"

namespace fxagent {

void fault_point(std::string_view) noexcept {}

}  // namespace fxagent
