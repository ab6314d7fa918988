// Places in the life of a command or a sample at which a test may kill the agent, as a power cut
// would. Any thread.
#pragma once

#include <string_view>

namespace fxagent {

/// Does nothing in the product. A test program that defines this function itself is linked with its
/// own definition, because this one is alone in its archive member.
void failpoint(std::string_view name) noexcept;

}  // namespace fxagent
