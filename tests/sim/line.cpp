#include "tests/sim/line.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <asio/co_spawn.hpp>
#include <asio/detached.hpp>
#include <asio/redirect_error.hpp>
#include <asio/use_awaitable.hpp>
#include <system_error>

namespace fxsim {
namespace {

using asio::redirect_error;
using asio::use_awaitable;

// More than any master has outstanding; what comes on top is lost, as in a UART nobody reads.
constexpr std::size_t kMaxWaiting = 1024;
// A serial server and a USB adapter hand on what their UART's FIFO gathers; a terminal hands on
// every character.
constexpr std::size_t kTcpChunk = 8;
constexpr std::size_t kPtyChunk = 1;
constexpr std::chrono::milliseconds kReopenPause{100};

}  // namespace

Line::Line(asio::io_context& io, LineSettings settings, Station& station)
    : io_(io),
      settings_(std::move(settings)),
      station_(station),
      character_time_(settings_.baud == 0
                          ? 0
                          : 1'000'000'000LL * settings_.bits_per_character / settings_.baud),
      jitter_(settings_.seed),
      more_waiting_(io),
      pace_(io) {}

void Line::open() {
  port_ = settings_.tcp;
  if (settings_.pty.empty()) {
    open_tcp();
  } else {
    open_pty();
  }
  asio::co_spawn(io_, respond(), asio::detached);
}

void Line::close() {
  closed_ = true;
  disconnect();
  pty_.reset();
  acceptor_.reset();
  more_waiting_.cancel();
  pace_.cancel();
}

void Line::open_pty() {
  pty_.emplace(settings_.pty);
  auto watch = std::make_shared<Session>(
      Session{asio::posix::stream_descriptor(io_, ::fcntl(pty_->watch(), F_DUPFD_CLOEXEC, 0)), {}});
  sessions_.push_back(watch);
  asio::co_spawn(io_, watch_pty(watch), asio::detached);
  add_session(::fcntl(pty_->master(), F_DUPFD_CLOEXEC, 0));
}

void Line::open_tcp() {
  const asio::ip::tcp::endpoint here(asio::ip::address_v4::loopback(), port_);
  acceptor_.emplace(io_, here, true);
  port_ = acceptor_->local_endpoint().port();
  asio::co_spawn(io_, accept(), asio::detached);
}

void Line::add_session(int fd) {
  auto session = std::make_shared<Session>(
      Session{asio::posix::stream_descriptor(io_, fd), station_.personality().make_framer()});
  session->stream.native_non_blocking(true);
  sessions_.push_back(session);
  asio::co_spawn(io_, receive(session), asio::detached);
}

asio::awaitable<void> Line::watch_pty(SessionPtr watch) {
  asio::error_code error;
  while (!error) {
    co_await watch->stream.async_wait(asio::posix::stream_descriptor::wait_read,
                                      redirect_error(use_awaitable, error));
    if (!error && pty_) pty_->notice_closing();
  }
}

asio::awaitable<void> Line::accept() {
  for (;;) {
    asio::error_code error;
    auto socket = co_await acceptor_->async_accept(redirect_error(use_awaitable, error));
    if (error) co_return;
    socket.set_option(asio::ip::tcp::no_delay(true), error);
    const int fd = socket.release(error);
    if (!error) add_session(fd);
  }
}

asio::awaitable<void> Line::receive(SessionPtr session) {
  std::array<std::uint8_t, 512> buffer{};
  std::vector<Frame> frames;
  for (;;) {
    asio::error_code error;
    const auto size = co_await session->stream.async_read_some(
        asio::buffer(buffer), redirect_error(use_awaitable, error));
    if (error) break;
    // The client's bytes are here at once; on the wire each takes its time, behind those that are
    // still on it.
    received_until_ = std::max(received_until_, Clock::now());
    for (std::size_t i = 0; i < size; ++i) {
      received_until_ += character_time_;
      session->framer->take(buffer[i], received_until_, frames);
    }
    for (auto& frame : frames)
      if (waiting_.size() < kMaxWaiting) waiting_.push_back({session, std::move(frame)});
    frames.clear();
    more_waiting_.cancel();
  }
  asio::error_code ignored;
  session->stream.close(ignored);
  std::erase(sessions_, session);
}

asio::awaitable<void> Line::respond() {
  while (!closed_) {
    if (waiting_.empty()) {
      asio::error_code cancelled;
      more_waiting_.expires_at(TimePoint::max());
      co_await more_waiting_.async_wait(redirect_error(use_awaitable, cancelled));
      continue;
    }
    auto request = std::move(waiting_.front());
    waiting_.pop_front();
    auto turnaround = settings_.turnaround;
    if (settings_.jitter.count() > 0)
      turnaround += std::chrono::milliseconds(
          std::uniform_int_distribution<std::int64_t>(0, settings_.jitter.count())(jitter_));
    // Everything is scheduled from the end of the request, not from when this thread woke up.
    const auto start = std::max(request.frame.complete, sent_until_) + turnaround;
    co_await until(start);
    if (closed_) co_return;
    if (pty_) pty_->notice_closing();
    auto answer = station_.answer(request.frame, start);
    const auto outage = answer.hang_up;
    co_await send(request.from, std::move(answer), start);
    if (outage) co_await hang_up(*outage);
  }
}

asio::awaitable<void> Line::send(SessionPtr to, Answer answer, TimePoint start) {
  const auto chunk = pty_ ? kPtyChunk : kTcpChunk;
  auto when = start;
  for (const auto& piece : answer.pieces) {
    when += piece.pause;
    const ByteView bytes = piece.bytes;
    const bool paced = piece.paced && settings_.baud != 0;
    const auto step = paced ? chunk : std::max<std::size_t>(bytes.size(), 1);
    for (std::size_t at = 0; at < bytes.size(); at += step) {
      const auto part = bytes.subspan(at, std::min(step, bytes.size() - at));
      if (paced) when += character_time_ * static_cast<std::int64_t>(part.size());
      co_await until(when);
      if (closed_ || station_.faults().dead()) co_return;
      put(*to, part);
    }
  }
  sent_until_ = when;
}

asio::awaitable<void> Line::hang_up(std::chrono::milliseconds outage) {
  disconnect();
  const bool serial = pty_.has_value();
  pty_.reset();
  if (outage.count() > 0) acceptor_.reset();
  auto when = Clock::now() + outage;
  for (bool open = false; !open;) {
    co_await until(when);
    if (closed_) co_return;
    open = reopen(serial);
    when = Clock::now() + kReopenPause;
  }
}

bool Line::reopen(bool serial) {
  try {
    if (serial) {
      open_pty();
    } else if (!acceptor_) {
      open_tcp();
    }
    return true;
  } catch (const std::system_error&) {
    return false;  // the name or the port is taken for the moment
  }
}

asio::awaitable<void> Line::until(TimePoint when) {
  if (when <= Clock::now()) co_return;
  asio::error_code cancelled;
  pace_.expires_at(when);
  co_await pace_.async_wait(redirect_error(use_awaitable, cancelled));
}

void Line::put(Session& session, ByteView bytes) {
  if (!session.stream.is_open()) return;
  const auto written = ::write(session.stream.native_handle(), bytes.data(), bytes.size());
  if (written > 0) station_.count_sent(static_cast<std::size_t>(written));
  // A full buffer means that nobody reads: the rest is lost, as on a serial line. Any other error
  // is the end of the connection, which receive() sees too.
}

void Line::disconnect() {
  for (const auto& session : sessions_) {
    asio::error_code ignored;
    session->stream.close(ignored);
  }
  sessions_.clear();
  waiting_.clear();
}

}  // namespace fxsim
