// Random numbers of a test, the same in every run.
#pragma once

#include <cstdint>
#include <random>

namespace fxagent::test {

class Pick {
 public:
  explicit Pick(std::uint32_t seed) : random_(seed) {}
  std::uint32_t operator()(std::uint32_t least, std::uint32_t most) {
    return std::uniform_int_distribution<std::uint32_t>(least, most)(random_);
  }

 private:
  std::mt19937 random_;
};

}  // namespace fxagent::test
