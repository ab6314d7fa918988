#include "tests/sim/line.h"

#include <fcntl.h>
#include <sys/socket.h>
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

// More than any master has outstanding. Anything beyond is lost, as in a UART that is not read.
constexpr std::size_t kMaxWaiting = 1024;
// Serial servers and USB adapters deliver what their UART's FIFO has gathered; a terminal delivers
// every character.
constexpr std::size_t kTcpChunk = 8;
constexpr std::size_t kPtyChunk = 1;
constexpr std::chrono::milliseconds kReopenPause{100};
constexpr std::size_t kMaxDatagram = 65'536;
// Bounds the table for clients that use a new port for every request.
constexpr std::size_t kMaxPeers = 256;

}  // namespace

Line::Line(asio::io_context& io, LineSettings settings)
    : io_(io),
      settings_(std::move(settings)),
      character_time_(settings_.baud == 0
                          ? 0
                          : 1'000'000'000LL * settings_.bits_per_character / settings_.baud) {}

void Line::attach(Station& station, const ResponseTime& response) {
  seats_.push_back(std::make_unique<Seat>(Seat{.station = station,
                                               .response = response,
                                               .jitter = std::minstd_rand(response.seed),
                                               .waiting = {},
                                               .pace = asio::steady_timer(io_),
                                               .sent_until = {}}));
}

void Line::open() {
  port_ = settings_.udp.value_or(settings_.tcp);
  if (!settings_.pty.empty()) return open_pty();
  try {
    settings_.udp ? open_udp() : open_tcp();
  } catch (const std::system_error& error) {
    throw std::system_error(error.code(), settings_.listen + ":" + std::to_string(port_));
  }
}

void Line::close() {
  closed_ = true;
  disconnect();
  pty_.reset();
  acceptor_.reset();
  udp_.reset();
  elsewhere_.reset();
  for (const auto& seat : seats_) seat->pace.cancel();
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
  const asio::ip::tcp::endpoint here(asio::ip::make_address(settings_.listen), port_);
  acceptor_.emplace(io_, here, true);
  port_ = acceptor_->local_endpoint().port();
  asio::co_spawn(io_, accept(), asio::detached);
}

void Line::open_udp() {
  using asio::ip::udp;
  const auto address = asio::ip::make_address(settings_.listen);
  udp_.emplace(io_, udp::endpoint(address, port_));
  port_ = udp_->local_endpoint().port();
  if (!elsewhere_) elsewhere_.emplace(io_, udp::endpoint(address, 0));
  asio::co_spawn(io_, receive_datagrams(), asio::detached);
}

void Line::add_session(int fd) {
  auto session =
      std::make_shared<Session>(Session{asio::posix::stream_descriptor(io_, fd),
                                        seats_.front()->station.personality().make_framer()});
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
    if (is_full()) {
      seats_.front()->station.count_turned_away();
      continue;  // destroying the socket closes the connection
    }
    socket.set_option(asio::ip::tcp::no_delay(true), error);
    const int fd = socket.release(error);
    if (!error) add_session(fd);
  }
}

/// True if the maximum number of connections is open. A connection whose client has hung up does
/// not count, even if that has not been read yet.
bool Line::is_full() const {
  const auto lives = [](const SessionPtr& session) {
    std::uint8_t byte = 0;
    return session->stream.is_open() &&
           ::recv(session->stream.native_handle(), &byte, 1, MSG_PEEK | MSG_DONTWAIT) != 0;
  };
  return settings_.connections != 0 &&
         static_cast<std::size_t>(std::ranges::count_if(sessions_, lives)) >= settings_.connections;
}

asio::awaitable<void> Line::receive_datagrams() {
  Bytes buffer(kMaxDatagram);
  for (;;) {
    asio::error_code error;
    asio::ip::udp::endpoint from;
    const auto size = co_await udp_->async_receive_from(asio::buffer(buffer), from,
                                                        redirect_error(use_awaitable, error));
    if (error) co_return;
    if (settings_.udp_peer_port != 0 && from.port() != settings_.udp_peer_port) {
      seats_.front()->station.count_stranger();
      continue;
    }
    distribute(session_of(from), frame_of(ByteView(buffer).first(size)));
  }
}

Line::SessionPtr Line::session_of(const asio::ip::udp::endpoint& peer) {
  const auto known = std::ranges::find(sessions_, peer, [](const auto& s) { return *s->peer; });
  if (known != sessions_.end()) return *known;
  if (sessions_.size() >= kMaxPeers) sessions_.erase(sessions_.begin());
  return sessions_.emplace_back(
      std::make_shared<Session>(Session{asio::posix::stream_descriptor(io_), {}, peer, {}}));
}

/// A datagram is exactly one frame; anything shorter or longer is not a frame.
Frame Line::frame_of(ByteView datagram) const {
  const auto now = Clock::now();
  std::vector<Frame> frames;
  const auto framer = seats_.front()->station.personality().make_framer();
  for (const auto byte : datagram) framer->take(byte, now, frames);
  if (frames.size() == 1 && frames[0].whole && frames[0].bytes.size() == datagram.size())
    return std::move(frames[0]);
  return {Bytes(datagram.begin(), datagram.end()), false, now};
}

asio::awaitable<void> Line::receive(SessionPtr session) {
  std::array<std::uint8_t, 512> buffer{};
  std::vector<Frame> frames;
  for (;;) {
    asio::error_code error;
    const auto size = co_await session->stream.async_read_some(
        asio::buffer(buffer), redirect_error(use_awaitable, error));
    if (error) break;
    if (settings_.strict && pty_ &&
        !pty_->client_is_set_to(settings_.baud, settings_.parity, settings_.two_stop_bits))
      continue;
    // All bytes from the client are here at once. On the wire each takes its time, after the bytes
    // that are still being transmitted.
    received_until_ = std::max(received_until_, Clock::now());
    for (std::size_t i = 0; i < size; ++i) {
      received_until_ += character_time_;
      session->framer->take(buffer[i], received_until_, frames);
    }
    for (const auto& frame : frames) distribute(session, frame);
    frames.clear();
  }
  asio::error_code ignored;
  session->stream.close(ignored);
  std::erase(sessions_, session);
}

void Line::distribute(const SessionPtr& from, const Frame& frame) {
  bool heard = false;
  for (const auto& seat : seats_) {
    if (frame.whole && !seat->station.personality().hears(frame)) continue;
    heard = true;
    if (seat->waiting.size() >= kMaxWaiting) continue;
    seat->waiting.push_back({from, frame});
    if (frame.whole && (seat->answering || seat->overtaken > 0)) seat->station.count_overlap();
    if (seat->answering) continue;
    seat->answering = true;
    asio::co_spawn(io_, respond(*seat), asio::detached);
  }
  if (!heard && settings_.gateway) answer_for_nobody(*from, frame);
}

asio::awaitable<void> Line::respond(Seat& seat) {
  while (!closed_ && !seat.waiting.empty()) {
    auto request = std::move(seat.waiting.front());
    seat.waiting.pop_front();
    auto turnaround = seat.response.turnaround;
    if (seat.response.jitter.count() > 0)
      turnaround += std::chrono::milliseconds(std::uniform_int_distribution<std::int64_t>(
          0, seat.response.jitter.count())(seat.jitter));
    // The schedule starts at the end of the request, not when this thread woke up.
    const auto start = std::max(request.frame.complete, seat.sent_until) + turnaround;
    if (start > Clock::now()) co_await until(seat, start);
    if (closed_) co_return;
    if (pty_) pty_->notice_closing();
    auto answer = seat.station.answer(request.frame, start);
    if (settings_.gateway && request.frame.whole && seat.station.faults().dead())
      answer_for_nobody(*request.from, request.frame);
    const auto outage = answer.hang_up;
    const auto first = std::max(start, request.frame.complete + answer.wait);
    if (answer.overtaken) {
      const auto when = first + *answer.overtaken;
      ++seat.overtaken;
      asio::co_spawn(io_, send_later(seat, request.from, std::move(answer), when), asio::detached);
    } else {
      co_await send(seat, request.from, std::move(answer), first);
    }
    if (outage) co_await hang_up(seat, *outage);
  }
  seat.answering = false;
}

asio::awaitable<void> Line::send_later(Seat& seat, SessionPtr to, Answer answer, TimePoint when) {
  asio::steady_timer timer(io_, when);
  asio::error_code error;
  co_await timer.async_wait(redirect_error(use_awaitable, error));
  if (error || closed_) co_return;
  --seat.overtaken;
  for (const auto& piece : answer.pieces)
    seat.station.count_sent(put(*to, piece.bytes, answer.from_elsewhere));
}

asio::awaitable<void> Line::send(Seat& seat, SessionPtr to, Answer answer, TimePoint start) {
  if (answer.coalesced) {
    for (const auto& piece : answer.pieces)
      to->kept_back.insert(to->kept_back.end(), piece.bytes.begin(), piece.bytes.end());
    co_return;
  }
  if (!answer.pieces.empty() && !to->kept_back.empty()) {
    auto& bytes = answer.pieces.front().bytes;
    bytes.insert(bytes.begin(), to->kept_back.begin(), to->kept_back.end());
    to->kept_back.clear();
  }
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
      if (when > Clock::now()) co_await until(seat, when);
      if (closed_ || seat.station.faults().dead()) co_return;
      seat.station.count_sent(put(*to, part, answer.from_elsewhere));
    }
  }
  seat.sent_until = when;
}

void Line::answer_for_nobody(Session& to, const Frame& frame) {
  put(to, seats_.front()->station.personality().nobody_there(frame));
}

asio::awaitable<void> Line::hang_up(Seat& seat, std::chrono::milliseconds outage) {
  disconnect();
  pty_.reset();
  if (outage.count() > 0) {
    acceptor_.reset();
    udp_.reset();
  }
  auto when = Clock::now() + outage;
  for (bool open = false; !open;) {
    if (when > Clock::now()) co_await until(seat, when);
    if (closed_) co_return;
    open = reopen();
    when = Clock::now() + kReopenPause;
  }
}

bool Line::reopen() {
  try {
    if (settings_.udp) {
      if (!udp_) open_udp();
    } else if (settings_.pty.empty()) {
      if (!acceptor_) open_tcp();
    } else if (!pty_) {
      open_pty();
    }
    return true;
  } catch (const std::system_error&) {
    return false;  // the name or the port is in use at the moment
  }
}

asio::awaitable<void> Line::until(Seat& seat, TimePoint when) {
  asio::error_code cancelled;
  seat.pace.expires_at(when);
  co_await seat.pace.async_wait(redirect_error(use_awaitable, cancelled));
}

/// Returns the number of bytes sent. A full buffer means that the client does not read: the rest is
/// lost, as on a serial line. Any other error ends the connection; receive() notices it too.
std::size_t Line::put(Session& session, ByteView bytes, bool from_elsewhere) {
  if (session.peer) {
    auto& socket = from_elsewhere ? elsewhere_ : udp_;
    asio::error_code error;
    return socket
               ? socket->send_to(asio::buffer(bytes.data(), bytes.size()), *session.peer, 0, error)
               : 0;
  }
  if (!session.stream.is_open()) return 0;
  const auto written = ::write(session.stream.native_handle(), bytes.data(), bytes.size());
  return written > 0 ? static_cast<std::size_t>(written) : 0;
}

void Line::disconnect() {
  for (const auto& session : sessions_) {
    asio::error_code ignored;
    session->stream.close(ignored);
  }
  sessions_.clear();
  for (const auto& seat : seats_) seat->waiting.clear();
}

}  // namespace fxsim
