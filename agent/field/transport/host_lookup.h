// Shared by TCP and UDP: resolves a host name or address, keeps file descriptors free for the rest
// of the agent, and names the cause of a fault. Field thread only.
#pragma once

#include <asio/any_io_executor.hpp>
#include <asio/awaitable.hpp>
#include <asio/error.hpp>
#include <asio/ip/address.hpp>
#include <memory>
#include <string>
#include <vector>

#include "agent/steady_time.h"
#include "protocol/value/result.h"

namespace fxagent {

/// Number of file descriptors that links must leave free: for the store and its journal, the
/// broker's socket and its successor, epoll, stderr, serial ports, and the files that a name lookup
/// opens for a moment.
inline constexpr int kFilesNotForLinks = 40;

/// True if `fd`, the socket that a link has just opened, is one of those.
bool takes_from_others(int fd);

/// Returns the cause of a failed connection or datagram, with what to check.
std::string why_failed(const asio::error_code& error);

/// Starts the thread that asio uses for name lookups. Without this call the first lookup would
/// start it, and a system without threads would fail only then. Throws std::system_error.
void start_looking_up(const asio::any_io_executor& executor);

class HostLookup final {
 public:
  /// Returns at least one address of `host`, in the system's order. Error: link_down if there is
  /// none by `deadline`, or after cancel(); the text begins with `channel`. `host` and `channel`
  /// must outlive the await.
  asio::awaitable<Result<std::vector<asio::ip::address>>> find(asio::any_io_executor executor,
                                                               const std::string& host,
                                                               const std::string& channel,
                                                               SteadyTime deadline);
  void cancel() noexcept;

 private:
  struct UnderWay;
  std::shared_ptr<UnderWay> under_way_;  ///< also owned by the lookup itself
};

}  // namespace fxagent
