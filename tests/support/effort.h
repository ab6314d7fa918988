#pragma once

/// How much a test with random inputs does.
namespace fxagent::test {

/// `times` in a normal build, a tenth of it under a sanitizer, where each takes ten to twenty times
/// as long and is there for what the sanitizer sees.
#ifdef FXAGENT_SANITIZED
constexpr int effort(int times) { return times / 10; }
#else
constexpr int effort(int times) { return times; }
#endif

}  // namespace fxagent::test
