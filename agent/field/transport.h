// PORT: bytes to and from one channel, with a deadline. Field thread only.
#pragma once

#include <asio/awaitable.hpp>
#include <chrono>
#include <cstdint>
#include <optional>
#include <span>

#include "agent/messages.h"
#include "protocol/bytes.h"
#include "protocol/result.h"

namespace fxagent {

using MutableBytes = std::span<std::uint8_t>;

class Transport {
 public:
  /// How far a write came. With an error and `sent` 0, surely no byte left the agent.
  struct Written {
    std::size_t sent = 0;
    std::optional<Error> error;
  };

  virtual ~Transport() = default;

  /// The clock of its deadlines.
  virtual SteadyTime now() const { return std::chrono::steady_clock::now(); }

  /// Opens the channel, or says why not: link_down with a text that names the path or host and the
  /// cure. Gives up at `deadline`. An open channel is closed first.
  virtual asio::awaitable<Result<void>> open(SteadyTime deadline) = 0;
  virtual bool is_open() const = 0;

  /// Hands all of `bytes` to the channel. `bytes` must stay alive until the await ends.
  virtual asio::awaitable<Written> write(ByteView bytes, SteadyTime deadline) = 0;

  /// Reads what has arrived, at least one byte, into `into`, which must stay alive until then.
  /// Errors: timeout (nothing by `deadline`), link_down (closed or broken; call open() again).
  virtual asio::awaitable<Result<std::size_t>> read_some(MutableBytes into,
                                                         SteadyTime deadline) = 0;

  /// What has arrived and was not read, so that it is not taken for the answer to what is asked
  /// next. Does not wait; takes at most kMostDiscarded bytes, or a peer that babbles would hold up
  /// all links. link_down where the peer turns out to have gone: then the channel is closed, and
  /// nothing was sent into it.
  virtual Result<Bytes> discard_input() = 0;
  static constexpr std::size_t kMostDiscarded = 65536;

  /// Whether what is written and read is datagrams: each a whole frame or none at all, never a part
  /// of one whose rest may follow.
  virtual bool has_datagrams() const { return false; }
  /// Whether the last read_some() left a part of its datagram, which the next one brings.
  virtual bool has_rest() const { return false; }
  /// Whether renew() does anything.
  virtual bool can_renew() const { return false; }
  /// From now on nothing is read that answers what was written before: a datagram socket takes
  /// another port. The channel is open before and after it; link_down where it is not afterwards.
  virtual Result<void> renew() { return {}; }

  /// Ends waiting reads and writes with link_down.
  virtual void close() noexcept = 0;
};

}  // namespace fxagent
