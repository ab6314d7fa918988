#include "agent/failpoint.h"

namespace fxagent {

void failpoint(std::string_view) noexcept {}

}  // namespace fxagent
