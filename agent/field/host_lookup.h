// The addresses of a host, by name or as they stand. Sockets to them leave files to the rest of the
// agent. Field thread only.
#pragma once

#include <asio/any_io_executor.hpp>
#include <asio/awaitable.hpp>
#include <asio/ip/address.hpp>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "agent/messages.h"
#include "protocol/result.h"

namespace fxagent {

/// Of the files that the process may have open so many are not for links: the store and its
/// journal, the broker's socket and the next one's, epoll, stderr, serial ports, and what resolving
/// a host name opens for a moment.
inline constexpr int kFilesNotForLinks = 40;

/// Whether the socket of a link, just opened, is one of those that are not for links.
bool takes_from_others(int fd);

/// asio looks names up on a thread of its own, which it starts with the first one: it is started
/// here, so that a system that has none says so at the start. Throws std::system_error then.
void start_looking_up(const asio::any_io_executor& executor);

class HostLookup final {
 public:
  /// At least one address of `host`, in the order of the system. link_down where there is none by
  /// `deadline`, or after cancel(); its text begins with `channel`. Both outlive the await.
  asio::awaitable<Result<std::vector<asio::ip::address>>> find(asio::any_io_executor executor,
                                                               const std::string& host,
                                                               const std::string& channel,
                                                               SteadyTime deadline);
  void cancel() noexcept;

 private:
  struct UnderWay;
  std::shared_ptr<UnderWay> under_way_;  ///< the lookup itself owns it too
};

}  // namespace fxagent
