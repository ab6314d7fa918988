#include "agent/field/bus/channel.h"

#include <gtest/gtest.h>

#include <asio/io_context.hpp>
#include <chrono>

#include "tests/agent/field/on_io.h"

namespace fxagent::test {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

/// A line that brings one byte in each `every`, by a clock of its own.
class Drip final : public Transport {
 public:
  explicit Drip(milliseconds every) : every_(every) {}

  SteadyTime now() const override { return now_; }
  asio::awaitable<Result<void>> open(SteadyTime) override {
    open_ = true;
    co_return Result<void>{};
  }
  bool is_open() const override { return open_; }
  asio::awaitable<Written> write(ByteView bytes, SteadyTime) override {
    co_return Written{bytes.size(), {}};
  }
  asio::awaitable<Result<std::size_t>> read_some(MutableBytes into, SteadyTime deadline) override {
    now_ = std::min(now_ + every_, deadline);
    if (now_ == deadline) co_return fail(ErrorCode::timeout, "nothing came");
    into[0] = 0x55;
    co_return std::size_t{1};
  }
  Result<Bytes> discard_input() override { return Bytes{}; }
  void close() noexcept override { open_ = false; }

 private:
  const milliseconds every_;
  SteadyTime now_{seconds(100)};
  bool open_ = false;
};

TEST(Channel, LineThatDripsWithoutEndIsClosedAndOneThatFallsQuietIsNot) {
  asio::io_context io;
  Channel never_quiet(std::make_unique<Drip>(milliseconds(40)));
  const Channel::Received received = run_on(io, never_quiet.open(milliseconds(0)));
  ASSERT_TRUE(received.error) << "a byte every 40 ms leaves no silence of 50 ms";
  EXPECT_TRUE(never_quiet.never_silent());
  EXPECT_FALSE(never_quiet.is_open());
  EXPECT_LT(received.total, 100U) << "after little more than 3 s";

  Channel quiet(std::make_unique<Drip>(milliseconds(60)));
  EXPECT_FALSE(run_on(io, quiet.open(milliseconds(0))).error);
  EXPECT_TRUE(quiet.is_open());
}

}  // namespace
}  // namespace fxagent::test
