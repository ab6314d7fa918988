#include "tests/agent/remote/remote_run.h"

#include <string_view>

#include "agent/failpoint.h"

namespace fxagent {

namespace test {

std::function<void()> at_judging;

}  // namespace test

/// In place of the product's, so that a test sees the disk at that moment.
void failpoint(std::string_view name) noexcept {
  if (test::at_judging && name == "remote_config_judged") test::at_judging();
}

}  // namespace fxagent
