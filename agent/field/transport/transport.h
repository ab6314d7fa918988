// PORT: bytes to and from one channel, with a deadline. Field thread only.
#pragma once

#include <asio/any_io_executor.hpp>
#include <asio/awaitable.hpp>
#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>

#include "agent/config/model.h"
#include "agent/steady_time.h"
#include "protocol/value/bytes.h"
#include "protocol/value/result.h"

namespace fxagent {

class LinePermit;
using MutableBytes = std::span<std::uint8_t>;

class Transport {
 public:
  /// Progress of a write. With an error and `sent` 0, no byte has left the agent.
  struct Written {
    std::size_t sent = 0;
    std::optional<Error> error;
  };

  virtual ~Transport() = default;

  /// The clock of its deadlines.
  virtual SteadyTime now() const { return std::chrono::steady_clock::now(); }

  /// Opens the channel; closes an open one first. Gives up at `deadline`. Error: link_down, with a
  /// text that names the path or host and the remedy.
  virtual asio::awaitable<Result<void>> open(SteadyTime deadline) = 0;
  virtual bool is_open() const = 0;

  /// Writes all of `bytes` to the channel. `bytes` must stay alive until the await ends.
  virtual asio::awaitable<Written> write(ByteView bytes, SteadyTime deadline) = 0;

  /// Reads at least one byte into `into`, which must stay alive until the await ends. Errors:
  /// timeout (nothing by `deadline`), link_down (closed or broken; call open() again).
  virtual asio::awaitable<Result<std::size_t>> read_some(MutableBytes into,
                                                         SteadyTime deadline) = 0;

  /// Returns what has arrived and was not read, so that it does not pass for the next answer. Does
  /// not wait. Takes at most kMostDiscarded bytes, because a peer that babbles would hold up all
  /// links. Error: link_down if the peer has gone; the channel is then closed, and nothing was sent
  /// into it.
  virtual Result<Bytes> discard_input() = 0;
  static constexpr std::size_t kMostDiscarded = 65536;

  /// True if writes and reads are datagrams: each a whole frame, never a part of one.
  virtual bool has_datagrams() const { return false; }
  /// True if the last read_some() left a part of its datagram for the next one.
  virtual bool has_rest() const { return false; }
  /// True if renew() has an effect.
  virtual bool can_renew() const { return false; }
  /// Moves a datagram socket to another port, so that answers to earlier requests are never read.
  /// Requires an open channel. Error: link_down if it is not open afterwards.
  virtual Result<void> renew() { return {}; }

  /// Closes the channel. Waiting reads and writes end with link_down.
  virtual void close() noexcept = 0;
};

/// Returns a closed transport to the port or address of the link. `permit` must outlive it; null:
/// it may write at any time. With a permit, open() waits until `listening` before it begins, and
/// write() sends nothing and fails with link_down if the permit does not allow it or another master
/// was heard.
std::unique_ptr<Transport> make_transport(const asio::any_io_executor& executor,
                                          const LinkConfig& link,
                                          const LinePermit* permit = nullptr);

// Each returns a closed transport of its kind.

/// A serial port: raw termios, exclusive, reopened by its path. On a pty, 7 data bits and parity
/// are tolerated although the kernel does not keep them; on a real port such a refusal is an error.
std::unique_ptr<Transport> make_serial_transport(asio::any_io_executor executor,
                                                 SerialSettings settings);
/// A TCP stream, with no-delay and keep-alive.
std::unique_ptr<Transport> make_tcp_transport(asio::any_io_executor executor, TcpSettings settings);
/// A datagram socket that accepts none from other senders. If the name has several addresses, each
/// open() takes the next one until one has answered.
std::unique_ptr<Transport> make_udp_transport(asio::any_io_executor executor, UdpSettings settings);

}  // namespace fxagent
