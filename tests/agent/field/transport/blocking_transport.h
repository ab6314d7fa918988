// The calls of a transport as blocking calls.
#pragma once

#include <gtest/gtest.h>

#include <asio/io_context.hpp>

#include "agent/field/transport/transport.h"
#include "tests/agent/field/on_io.h"

namespace fxagent::test {

/// An io_context, and the calls of a transport that end when it has answered.
struct TransportTest : ::testing::Test {
  /// Less than run_on() waits: a call that takes too long ends on its own.
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
    const ByteView bytes(reinterpret_cast<const std::uint8_t*>(text.data()), text.size());
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

}  // namespace fxagent::test
