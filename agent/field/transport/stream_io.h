// Reads and writes under a Deadline, for serial ports and sockets; and a wait on a timer.
#pragma once

#include <unistd.h>

#include <asio/buffer.hpp>
#include <asio/experimental/as_tuple.hpp>
#include <asio/steady_timer.hpp>
#include <asio/use_awaitable.hpp>
#include <cerrno>
#include <string>
#include <tuple>
#include <utility>

#include "agent/field/transport/transport.h"
#include "agent/steady_time.h"

namespace fxagent {

/// A deadline for the reads and writes of one stream that costs no timer call while traffic flows.
/// One wait stays armed; a later deadline only changes a number. Field thread only.
/// `Stream` needs cancel(ec). The deadline and its stream must outlive the io_context's last run.
template <class Stream>
class Deadline final {
 public:
  Deadline(asio::any_io_executor executor, Stream& stream) : timer_(executor), stream_(stream) {}
  Deadline(const Deadline&) = delete;
  Deadline& operator=(const Deadline&) = delete;

  /// Cancels the stream's operation at `at`.
  void arm(SteadyTime at) {
    at_ = at;
    passed_ = false;
    if (!waiting_ || at < timer_.expiry()) start_wait(at);
  }
  void disarm() { at_ = SteadyTime::max(); }
  /// Also ends the armed wait, so that an io_context without other work can finish.
  void cancel() {
    disarm();
    waiting_ = false;
    timer_.cancel();
  }
  /// True if the deadline caused the last cancellation.
  bool passed() const { return passed_; }

 private:
  void start_wait(SteadyTime at) {
    waiting_ = true;
    timer_.expires_at(at);
    timer_.async_wait([this](const asio::error_code& error) {
      if (error) return;  // moved to an earlier time, which has a wait of its own
      waiting_ = false;
      if (at_ == SteadyTime::max()) return;
      if (std::chrono::steady_clock::now() < at_) return start_wait(at_);
      passed_ = true;
      asio::error_code ignored;
      stream_.cancel(ignored);
    });
  }

  asio::steady_timer timer_;
  Stream& stream_;
  SteadyTime at_ = SteadyTime::max();
  bool waiting_ = false;
  bool passed_ = false;
};

/// Appends what has arrived at a non-blocking descriptor, at most kMostDiscarded bytes. Returns 0,
/// or why the descriptor is of no more use: an errno, ENODEV at its end.
inline int read_waiting(int fd, Bytes& found) {
  std::uint8_t chunk[512];
  while (found.size() < Transport::kMostDiscarded) {
    const auto count = ::read(fd, chunk, sizeof chunk);
    if (count < 0) return errno == EAGAIN || errno == EINTR ? 0 : errno;
    if (count == 0) return ENODEV;
    found.insert(found.end(), chunk, chunk + count);
  }
  return 0;
}

inline constexpr auto use_result = asio::experimental::as_tuple(asio::use_awaitable);

/// Waits until `at`, or until the timer is cancelled. The timer must outlive the await.
inline asio::awaitable<void> wait_until(asio::steady_timer& timer, SteadyTime at) {
  timer.expires_at(at);
  co_await timer.async_wait(use_result);
}

/// A transport over an asio stream: what serial ports and TCP have in common. open() must set the
/// stream to non-blocking mode.
template <class Stream>
class StreamTransport : public Transport {
 public:
  /// `name` is for error texts.
  StreamTransport(const asio::any_io_executor& executor, std::string name)
      : name_(std::move(name)), stream_(executor), deadline_(executor, stream_) {}

  bool is_open() const override { return stream_.is_open(); }

  asio::awaitable<Written> write(ByteView bytes, SteadyTime at) override {
    Written written;
    deadline_.arm(at);
    while (written.sent < bytes.size()) {
      const ByteView rest = bytes.subspan(written.sent);
      // The stream nearly always has room, and then no turn of the event loop is needed.
      asio::error_code error;
      std::size_t count = stream_.write_some(asio::buffer(rest.data(), rest.size()), error);
      if (error == asio::error::would_block)
        std::tie(error, count) =
            co_await stream_.async_write_some(asio::buffer(rest.data(), rest.size()), use_result);
      written.sent += count;
      if (!error) continue;
      const std::string why =
          deadline_.passed() ? "the line accepts no more bytes" : error.message();
      written.error = Error{ErrorCode::link_down, name_ + ": " + why};
      break;
    }
    deadline_.disarm();
    co_return written;
  }

  asio::awaitable<Result<std::size_t>> read_some(MutableBytes into, SteadyTime at) override {
    deadline_.arm(at);
    const auto [error, count] =
        co_await stream_.async_read_some(asio::buffer(into.data(), into.size()), use_result);
    deadline_.disarm();
    if (!error && count > 0) co_return count;
    if (error == asio::error::operation_aborted && deadline_.passed())
      co_return fail(ErrorCode::timeout, "no answer on " + name_);
    const bool by_peer = !error || error == asio::error::eof;
    co_return fail(ErrorCode::link_down,
                   name_ + ": " + (by_peer ? "the peer closed the connection" : error.message()));
  }

  void close() noexcept override {
    deadline_.cancel();
    asio::error_code ignored;
    if (stream_.is_open()) stream_.close(ignored);
  }

 protected:
  const std::string name_;
  Stream stream_;
  Deadline<Stream> deadline_;
};

}  // namespace fxagent
