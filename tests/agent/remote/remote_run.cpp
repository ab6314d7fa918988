#include "tests/agent/remote/remote_run.h"

#include <string_view>

#include "agent/failpoint.h"

namespace fxagent {

namespace test {

std::function<void()> at_judging;

}  // namespace test

/// Replaces the product's failpoint(), so that a test can inspect the disk at that moment.
void failpoint(std::string_view name) noexcept {
  if (test::at_judging && name == "remote_config_judged") test::at_judging();
}

}  // namespace fxagent
