// Sends one request and receives its answer, on a channel that is in order (bus.h). Removes echoes,
// measures times, and counts and traces what passes. On UDP each datagram is judged separately. If
// answers carry no numbers, each request uses a port of its own; with a fixed port, the channel is
// treated like a serial line. Field thread only.
#pragma once

#include <asio/awaitable.hpp>
#include <asio/steady_timer.hpp>
#include <chrono>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <utility>

#include "agent/config/model.h"
#include "agent/config/wiring.h"
#include "agent/field/bus/channel.h"
#include "agent/field/bus/exchange.h"
#include "agent/field/bus/overheard.h"
#include "agent/field/bus/wire_trace.h"
#include "agent/field/transport/transport.h"
#include "agent/handover/command_message.h"
#include "agent/handover/field_health.h"
#include "agent/recorder/frame_ring.h"
#include "protocol/codec.h"

namespace fxagent {

/// The properties of a device that the bus needs. Must outlive the exchange.
struct Station {
  /// Codec of the device, or of the command in progress. Shared with the trace until it has
  /// explained the frames.
  std::shared_ptr<const Codec> codec;
  std::string_view device;  ///< its name; empty: unknown
  std::chrono::milliseconds timeout{1000};
  std::chrono::milliseconds gap{0};  ///< silence before a request
  EnquirePolicy enquire = EnquirePolicy::open;
  bool echo = false;                      ///< the line returns what is sent
  Wiring wiring{};                        ///< for error texts
  std::uint16_t recorded_as = kNoDevice;  ///< FrameRing::number() of the device
  std::uint32_t handshake_in = 0;  ///< Channel::session() of its last answered enquiry; 0: none
  FrameTrace* trace = nullptr;     ///< receives every frame of a command; null for polls
};

class Wire final {
 public:
  struct Counters : BusCounters {
    std::chrono::nanoseconds busy{0};  ///< in exchanges and in the silence before them
    PercentileWindow turnaround_ms;
    std::unique_ptr<LinkDurations> durations;  ///< null: metrics are off
  };

  /// `char_time` 0: speed unknown. The transport must be closed.
  Wire(asio::any_io_executor executor, std::unique_ptr<Transport> transport,
       std::chrono::nanoseconds char_time);

  /// Same as Channel::open(); traces what it receives.
  asio::awaitable<Result<void>> open(std::chrono::nanoseconds listening);
  /// Closes the channel and ends what is in progress, including listening and the gap before a
  /// request.
  void close() noexcept;

  /// Sends a request and receives its answer. Checks `not_after` just before the first byte.
  asio::awaitable<Exchange> exchange(const Station& station, Request request, SteadyTime not_after);
  /// Earliest time of the next request: the end of the pause after a broadcast.
  SteadyTime not_before() const { return not_before_; }
  // Between exchanges. Both judge what has come, by `codec`.
  /// Takes what has arrived, without waiting. Error: the channel is closed.
  Result<void> take_arrived(const Codec& codec);
  /// Waits for silence as Channel::listen(). False: the channel is closed.
  asio::awaitable<bool> drain(const Codec& codec, SteadyTime until, std::chrono::nanoseconds quiet);

  /// Passes each frame to `trace`; null: frames are neither logged nor recorded.
  void trace_to(std::unique_ptr<WireTrace> trace) { trace_ = std::move(trace); }
  bool is_traced() const { return trace_ != nullptr && trace_->logs(); }
  /// Sets the station of the following frames, for the trace.
  void begin(const Station& station);

  Channel& channel() { return channel_; }
  const Channel& channel() const { return channel_; }
  Overheard& overheard() { return overheard_; }
  const Overheard& overheard() const { return overheard_; }
  Counters& counters() { return counters_; }
  std::chrono::nanoseconds char_time() const { return char_time_; }
  SteadyTime now() const { return channel_.transport().now(); }

 private:
  /// Receives the answer. With `echo`, first removes `sent` from the received bytes.
  asio::awaitable<void> receive(const Codec& codec, const Request& request, const Bytes& sent,
                                bool echo, SteadyTime deadline, Exchange& exchange);
  /// Counts, traces and judges bytes that are not part of an answer.
  void note_unexpected(const Codec& codec, ByteView bytes);
  void note_error(const Station& station, const Exchange& exchange);
  /// Judges the bytes before and after an answer.
  void note_around_answer(const Codec& codec, const Bytes& sent, const Reply& reply);
  /// Counts the outcome. Without an answer, closes the channel or records that one may come late.
  void note_outcome(const Station& station, const Request& request, const Exchange& exchange);

  Channel channel_;
  Overheard overheard_;
  asio::steady_timer timer_;
  const std::chrono::nanoseconds char_time_;
  std::uint16_t tag_ = 0;
  SteadyTime last_activity_{};  ///< last byte in either direction, as far as known
  SteadyTime not_before_{};
  Bytes rx_;
  std::unique_ptr<WireTrace> trace_;
  Counters counters_;
};

}  // namespace fxagent
