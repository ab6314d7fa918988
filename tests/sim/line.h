// One wire: a pseudo terminal, a TCP listener or a UDP port, with the transmission time of its
// characters and the stations on it. It carries bytes and does not interpret them.
#pragma once

#include <asio/awaitable.hpp>
#include <asio/io_context.hpp>
#include <asio/ip/tcp.hpp>
#include <asio/ip/udp.hpp>
#include <asio/posix/stream_descriptor.hpp>
#include <asio/steady_timer.hpp>
#include <deque>
#include <memory>
#include <optional>
#include <random>
#include <vector>

#include "tests/sim/config.h"
#include "tests/sim/pty.h"
#include "tests/sim/station.h"

namespace fxsim {

/// Every station receives every request; the addressed one answers. A station sends its answers one
/// after another, however many clients there are. Answers of two stations may collide on the wire.
/// Lives on the thread of `io`. Must outlive the run of `io`, not `io` itself.
class Line final {
 public:
  Line(asio::io_context& io, LineSettings settings);

  /// Call at least once, before open(). All stations of a line use the same protocol.
  void attach(Station& station, const ResponseTime& response);
  /// Opens the line and starts to serve. Throws std::system_error.
  void open();
  void close();
  /// The port of a TCP or UDP line. Valid once open.
  std::uint16_t port() const { return port_; }

 private:
  struct Session {
    asio::posix::stream_descriptor stream;
    std::unique_ptr<Framer> framer;
    std::optional<asio::ip::udp::endpoint> peer{};  // destination; UDP only
    Bytes kept_back{};                              // sent before the next answer
  };
  using SessionPtr = std::shared_ptr<Session>;  // owners: sessions_, its receive(), its requests
  struct Waiting {
    SessionPtr from;
    Frame frame;
  };

  struct Seat {  // per station
    Station& station;
    ResponseTime response;
    std::minstd_rand jitter;
    std::deque<Waiting> waiting;
    bool answering = false;  // respond() is running
    unsigned overtaken = 0;  // number of answers that others may overtake
    asio::steady_timer pace;
    TimePoint sent_until;  // end of its own answers on the wire
  };

  void open_pty();
  void open_tcp();
  void add_session(int fd);
  asio::awaitable<void> watch_pty(SessionPtr watch);
  void open_udp();
  bool is_full() const;
  asio::awaitable<void> accept();
  asio::awaitable<void> receive_datagrams();
  SessionPtr session_of(const asio::ip::udp::endpoint& peer);
  Frame frame_of(ByteView datagram) const;
  asio::awaitable<void> receive(SessionPtr session);
  void distribute(const SessionPtr& from, const Frame& frame);
  asio::awaitable<void> respond(Seat& seat);
  asio::awaitable<void> send(Seat& seat, SessionPtr to, Answer answer, TimePoint start);
  asio::awaitable<void> send_later(Seat& seat, SessionPtr to, Answer answer, TimePoint when);
  void answer_for_nobody(Session& to, const Frame& frame);
  asio::awaitable<void> hang_up(Seat& seat, std::chrono::milliseconds outage);
  bool reopen();
  asio::awaitable<void> until(Seat& seat, TimePoint when);
  std::size_t put(Session& session, ByteView bytes, bool from_elsewhere = false);
  void disconnect();

  asio::io_context& io_;
  LineSettings settings_;
  std::chrono::nanoseconds character_time_;
  std::vector<std::unique_ptr<Seat>> seats_;
  std::optional<Pty> pty_;
  std::optional<asio::ip::tcp::acceptor> acceptor_;
  std::optional<asio::ip::udp::socket> udp_;
  std::optional<asio::ip::udp::socket> elsewhere_;  // another port at the same address
  std::uint16_t port_ = 0;
  std::vector<SessionPtr> sessions_;
  TimePoint received_until_;  // the wire towards the stations is busy until then
  bool closed_ = false;
};

}  // namespace fxsim
