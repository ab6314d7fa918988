// Serialises requests on one channel and never matches a late answer to a newer request. All access
// to the channel goes through here. Field thread only.
#pragma once

#include <asio/awaitable.hpp>
#include <chrono>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "agent/field/bus/exchange.h"
#include "agent/field/bus/wire.h"
#include "agent/field/transport/transport.h"
#include "protocol/codec.h"

namespace fxagent {

class Bus final {
 public:
  /// `char_time` 0: speed unknown. `listening` as in LinkConfig. The transport must be closed.
  Bus(asio::any_io_executor executor, std::unique_ptr<Transport> transport,
      std::chrono::nanoseconds char_time,
      std::chrono::nanoseconds listening = std::chrono::nanoseconds{0})
      : wire_(std::move(executor), std::move(transport), char_time), listening_(listening) {}
  Bus(const Bus&) = delete;
  Bus& operator=(const Bus&) = delete;

  /// See Channel::open().
  asio::awaitable<Result<void>> open() { return wire_.open(listening_); }
  bool is_open() const { return channel().is_open(); }
  /// Sets how long open() listens. Takes effect at the next open().
  void set_listening(std::chrono::nanoseconds listening) { listening_ = listening; }
  /// Closes the channel and ends what is in progress, including listening and the gap before a
  /// request.
  void close() noexcept { wire_.close(); }

  /// Sends one request and returns its outcome. Checks `not_after` just before the first byte.
  ///
  /// If an earlier answer may still come, first listens until it no longer can, and enquires unless
  /// the station's policy is `never`. Also reads a probe after a lost ACK, and before a write if a
  /// read's answer was lost and the enquiry does not settle that. Otherwise enquires as the policy
  /// says. If an enquiry or a probe fails, sends nothing else and returns its outcome with `sent`
  /// false.
  ///
  /// While the bus is doubted, listens before and after the request. Each silence lasts as long as
  /// the slowest answer may take. A probe with an answer of another length precedes the request.
  /// Data are then marked `doubted`; any other answer is returned as garbled, because it proves
  /// nothing.
  ///
  /// While the bus is wary, sends a read twice and returns the second answer. If a foreign answer
  /// took the place of the first, the second is the device's own.
  asio::awaitable<Exchange> exchange(Station& station, Request request,
                                     SteadyTime not_after = SteadyTime::max());

  const Channel& channel() const { return wire_.channel(); }
  /// Foreign answers found on the bus, and the clean exchanges since.
  const BusDoubt& doubt() const { return overheard_.doubt(); }
  const Bytes& last_unexpected() const { return overheard_.last_unexpected(); }
  std::string unexpected_text() const { return overheard_.unexpected_text(); }
  /// See Echo::is_found().
  bool echo_found() const { return overheard_.echo().is_found(); }
  void trace_to(std::unique_ptr<WireTrace> trace) { wire_.trace_to(std::move(trace)); }
  bool is_traced() const { return wire_.is_traced(); }
  Wire::Counters& counters() { return wire_.counters(); }
  /// See Wire::not_before().
  SteadyTime not_before() const { return wire_.not_before(); }

 private:
  /// Performs one exchange on a line that is in order, then judges its answer.
  asio::awaitable<Exchange> ask(Station& station, const Request& request, SteadyTime not_after);
  struct Prepared {
    std::optional<Exchange> failure;   ///< the device did not answer, or the channel closed
    std::chrono::nanoseconds rest{0};  ///< line time of an enquiry
  };
  /// Puts the line in order.
  asio::awaitable<Prepared> prepare(Station& station, const Request& request);
  /// Reads something whose answer cannot be an older one, if the protocol has such a read.
  /// Afterwards no older answer is on its way. Returns the probe that went unanswered, if any.
  asio::awaitable<std::optional<Exchange>> probe(const Station& station, const Request& request);
  /// Returns how long the slowest answer on this line may take.
  std::chrono::nanoseconds quiet_in_doubt() const;

  Wire wire_;
  Overheard& overheard_{wire_.overheard()};
  std::chrono::nanoseconds listening_;
  std::chrono::nanoseconds slowest_{0};  ///< longest timeout of the stations asked so far
};

}  // namespace fxagent
