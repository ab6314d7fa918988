// The channel of a link: its sessions, and the silence on it. A session lasts from open() until the
// channel is closed, by the agent or by its peer. Field thread only.
#pragma once

#include <asio/awaitable.hpp>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "agent/field/transport/transport.h"
#include "agent/steady_time.h"
#include "protocol/value/bytes.h"
#include "protocol/value/result.h"

namespace fxagent {

class Channel final {
 public:
  /// Bytes received while waiting for the line to fall quiet.
  struct Received {
    Bytes bytes;                   ///< the first of them: Overheard::kMostJudged or a few more
    std::size_t total = 0;         ///< number of bytes received
    std::optional<Error> error{};  ///< set if the channel did not open or is closed
  };
  /// A line that brings this many bytes never falls quiet.
  static constexpr std::size_t kMostDrained = Transport::kMostDiscarded;

  /// `transport` must be closed.
  explicit Channel(std::unique_ptr<Transport> transport) : transport_(std::move(transport)) {}

  /// Opens the channel. Then listens for `listening`, and until the line is quiet: an answer to an
  /// earlier session or to a dead agent may still be on its way. Does not listen on UDP with a port
  /// for each request. Error: link_down, also if the line does not fall quiet; see never_silent().
  asio::awaitable<Received> open(std::chrono::nanoseconds listening);
  bool is_open() const { return transport_->is_open(); }
  /// Listens until `until` and until nothing has come for `quiet`. Closes the channel if that takes
  /// 3 s longer, or after kMostDrained bytes.
  asio::awaitable<Received> listen(SteadyTime until, std::chrono::nanoseconds quiet);

  // Each closes the channel.
  void close() noexcept { transport_->close(); }
  /// Call when the peer has closed it, or after an error. `why` is for people.
  void lose(std::string why);
  /// Call if a late answer, or the rest of one, could pass for that of another request: it cannot
  /// reach a new channel. This is not a loss: call open() again.
  void close_after_silence();
  /// Call if bytes arrive without end.
  void close_never_silent();

  /// Records that a request was answered over it.
  void answered() { answered_ = ever_answered_ = true; }
  /// Records that a request was answered, and that no other bytes can pass for the answer: the line
  /// is not always busy.
  void answered_beyond_doubt() { never_silent_ = false; }

  /// Incremented each time the channel opens. A handshake with a device is valid for one session
  /// only.
  std::uint32_t session() const { return session_; }
  /// Returns the end of the last open(), successful or not.
  SteadyTime open_ended() const { return open_ended_; }
  /// True if anything was answered in the current or last session; or in any session.
  bool was_answered() const { return answered_; }
  bool was_ever_answered() const { return ever_answered_; }
  /// True if the channel was closed, not by the agent, before anything was answered over it.
  bool closed_unanswered() const { return closed_unanswered_; }
  bool closed_after_silence() const { return closed_after_silence_ && !is_open(); }
  /// True if the channel was closed because bytes came without end, and no request was answered
  /// since.
  bool never_silent() const { return never_silent_; }
  /// Returns why the channel is closed, for people.
  const std::string& why_lost() const { return why_lost_; }

  Transport& transport() { return *transport_; }
  const Transport& transport() const { return *transport_; }

 private:
  std::unique_ptr<Transport> transport_;
  std::uint32_t session_ = 0;
  SteadyTime open_ended_{};
  bool never_silent_ = false;
  bool answered_ = false;  ///< in this session
  bool ever_answered_ = false;
  bool closed_unanswered_ = false;
  bool closed_after_silence_ = false;
  std::string why_lost_;
};

}  // namespace fxagent
