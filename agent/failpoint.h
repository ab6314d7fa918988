// Places in the life of a command and of a sample where a test may end the agent, as a power cut
// would. Any thread.
#pragma once

#include <string_view>

namespace fxagent {

/// Does nothing in the product. A test program that defines it by itself is linked with that
/// definition instead: this one stands alone in its archive member.
void failpoint(std::string_view name) noexcept;

}  // namespace fxagent
