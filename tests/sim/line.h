// One wire: a pseudo terminal or a TCP listener, the time its characters take, and the station at
// its end. Bytes travel here and nothing is understood.
#pragma once

#include <asio/awaitable.hpp>
#include <asio/io_context.hpp>
#include <asio/ip/tcp.hpp>
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

/// Half duplex, as the dialogue is: one answer after the other, however many clients there are.
/// Lives on the thread of `io`. Must outlive the run of `io`, not `io` itself.
class Line final {
 public:
  Line(asio::io_context& io, LineSettings settings, Station& station);

  /// Opens and starts to serve. Throws std::system_error.
  void open();
  void close();
  /// The port of a TCP line, once open.
  std::uint16_t port() const { return port_; }

 private:
  struct Session {
    asio::posix::stream_descriptor stream;
    std::unique_ptr<Framer> framer;
  };
  using SessionPtr = std::shared_ptr<Session>;  // owners: sessions_, its receive(), its requests
  struct Waiting {
    SessionPtr from;
    Frame frame;
  };

  void open_pty();
  void open_tcp();
  void add_session(int fd);
  asio::awaitable<void> watch_pty(SessionPtr watch);
  asio::awaitable<void> accept();
  asio::awaitable<void> receive(SessionPtr session);
  asio::awaitable<void> respond();
  asio::awaitable<void> send(SessionPtr to, Answer answer, TimePoint start);
  asio::awaitable<void> hang_up(std::chrono::milliseconds outage);
  bool reopen(bool serial);
  asio::awaitable<void> until(TimePoint when);
  void put(Session& session, ByteView bytes);
  void disconnect();

  asio::io_context& io_;
  LineSettings settings_;
  Station& station_;
  std::chrono::nanoseconds character_time_;
  std::mt19937 jitter_;
  std::optional<Pty> pty_;
  std::optional<asio::ip::tcp::acceptor> acceptor_;
  std::uint16_t port_ = 0;
  std::vector<SessionPtr> sessions_;
  std::deque<Waiting> waiting_;
  asio::steady_timer more_waiting_;  // cancelled when waiting_ gets its next request
  asio::steady_timer pace_;
  TimePoint received_until_;  // the wire towards the PLC is busy until then
  TimePoint sent_until_;      // the wire from the PLC
  bool closed_ = false;
};

}  // namespace fxsim
