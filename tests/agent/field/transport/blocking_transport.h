// The calls of a transport as blocking calls, and the limit of open files, lowered for a test.
#pragma once

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <asio/io_context.hpp>

#include "agent/field/transport/transport.h"
#include "tests/agent/field/on_io.h"

namespace fxagent::test {

/// An io_context, and the calls of a transport that end when it has answered.
struct TransportTest : ::testing::Test {
  /// Less than run_on() waits: a call that takes too long ends by itself.
  static constexpr std::chrono::milliseconds kWithin = kLimit / 2;

  Result<void> open(Transport& transport) {
    return run_on(io, transport.open(std::chrono::steady_clock::now() + kWithin));
  }
  void open_well(Transport& transport) {
    const auto opened = open(transport);
    ASSERT_TRUE(opened) << opened.error().text;
  }
  Transport::Written write(Transport& transport, const std::string& text,
                           std::chrono::milliseconds within = kWithin) {
    const Bytes bytes(text.begin(), text.end());
    return run_on(io, transport.write(bytes, std::chrono::steady_clock::now() + within));
  }
  /// Returns the bytes that arrived, at most `room`; "timeout"; or "link_down" for any other error,
  /// whose text is then in `read_error`.
  std::string read(Transport& transport, std::chrono::milliseconds within = kWithin,
                   std::size_t room = 64) {
    Bytes into(room);
    const auto got =
        run_on(io, transport.read_some(into, std::chrono::steady_clock::now() + within));
    if (got) return {into.begin(), into.begin() + static_cast<std::ptrdiff_t>(*got)};
    read_error = got.error().text;
    return got.error().code == ErrorCode::timeout ? "timeout" : "link_down";
  }

  asio::io_context io;
  std::string read_error;
};

/// Changes the limit of open files until the test is over.
class OpenFiles final {
 public:
  explicit OpenFiles(rlim_t allowed) {
    EXPECT_EQ(getrlimit(RLIMIT_NOFILE, &before_), 0);
    rlimit low = before_;
    low.rlim_cur = allowed;
    EXPECT_EQ(setrlimit(RLIMIT_NOFILE, &low), 0);
  }
  OpenFiles(const OpenFiles&) = delete;
  OpenFiles& operator=(const OpenFiles&) = delete;
  ~OpenFiles() { setrlimit(RLIMIT_NOFILE, &before_); }

 private:
  rlimit before_{};
};

}  // namespace fxagent::test
