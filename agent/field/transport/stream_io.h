// Reads and writes that serial ports and sockets share: asio streams under a Deadline.
#pragma once

#include <asio/buffer.hpp>
#include <asio/experimental/as_tuple.hpp>
#include <asio/use_awaitable.hpp>
#include <string>
#include <tuple>

#include "agent/field/transport/deadline.h"
#include "agent/field/transport/transport.h"

namespace fxagent {

inline constexpr auto use_result = asio::experimental::as_tuple(asio::use_awaitable);

/// Same as Transport::read_some(). `name` is for the error text.
template <class Stream>
asio::awaitable<Result<std::size_t>> read_some(Stream& stream, Deadline<Stream>& deadline,
                                               MutableBytes into, SteadyTime at,
                                               const std::string& name) {
  deadline.arm(at);
  const auto [error, count] =
      co_await stream.async_read_some(asio::buffer(into.data(), into.size()), use_result);
  deadline.disarm();
  if (!error && count > 0) co_return count;
  if (error == asio::error::operation_aborted && deadline.passed())
    co_return fail(ErrorCode::timeout, "no answer on " + name);
  const bool by_peer = !error || error == asio::error::eof;
  co_return fail(ErrorCode::link_down,
                 name + ": " + (by_peer ? "the peer closed the connection" : error.message()));
}

/// Same as Transport::write(). The stream must be in non-blocking mode.
template <class Stream>
asio::awaitable<Transport::Written> write_all(Stream& stream, Deadline<Stream>& deadline,
                                              ByteView bytes, SteadyTime at,
                                              const std::string& name) {
  Transport::Written written;
  deadline.arm(at);
  while (written.sent < bytes.size()) {
    const ByteView rest = bytes.subspan(written.sent);
    // The stream nearly always has room, and then no turn of the event loop is needed.
    asio::error_code error;
    std::size_t count = stream.write_some(asio::buffer(rest.data(), rest.size()), error);
    if (error == asio::error::would_block)
      std::tie(error, count) =
          co_await stream.async_write_some(asio::buffer(rest.data(), rest.size()), use_result);
    written.sent += count;
    if (!error) continue;
    const std::string why = deadline.passed() ? "the line accepts no more bytes" : error.message();
    written.error = Error{ErrorCode::link_down, name + ": " + why};
    break;
  }
  deadline.disarm();
  co_return written;
}

}  // namespace fxagent
