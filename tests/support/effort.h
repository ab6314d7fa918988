#pragma once

/// Scales the number of repetitions of a test with random inputs.
namespace fxagent::test {

/// `times` in a normal build; a tenth of it under a sanitizer, where each repetition takes ten to
/// twenty times as long and only the sanitizer's findings matter.
#ifdef FXAGENT_SANITIZED
constexpr int effort(int times) { return times / 10; }
#else
constexpr int effort(int times) { return times; }
#endif

}  // namespace fxagent::test
