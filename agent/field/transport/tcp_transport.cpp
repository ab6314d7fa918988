#include "agent/field/transport/transport.h"

#include <netinet/tcp.h>
#include <sys/socket.h>

#include <asio/ip/tcp.hpp>
#include <utility>

#include "agent/field/transport/host_lookup.h"
#include "agent/field/transport/stream_io.h"

namespace fxagent {
namespace {

using asio::ip::tcp;

// Detects a cable pulled between two polls within about 20 s, even while nothing is sent.
constexpr int kKeepAliveIdleSeconds = 10;
constexpr int kKeepAliveIntervalSeconds = 3;
constexpr int kKeepAliveProbes = 3;

std::string why_not_connected(const asio::error_code& error, bool is_late) {
  if (is_late)
    return "no answer to the connection request: is the device on, is this its address, and does "
           "every firewall allow the port?";
  if (error == asio::error::connection_refused)
    return "connection refused: is this the device's port, and is the port open in the device's "
           "settings, for TCP?";
  return why_failed(error);
}

class TcpTransport final : public StreamTransport<tcp::socket> {
 public:
  TcpTransport(const asio::any_io_executor& executor, TcpSettings settings)
      : StreamTransport(executor, settings.host + ":" + std::to_string(settings.port)),
        settings_(std::move(settings)) {}

  asio::awaitable<Result<void>> open(SteadyTime at) override {
    close();
    const auto found = co_await lookup_.find(stream_.get_executor(), settings_.host, name_, at);
    if (!found) co_return fail(found);
    Result<void> outcome;
    auto left = static_cast<int>(found->size());
    for (const asio::ip::address& address : *found) {
      // An address that does not answer leaves time for those after it.
      const SteadyTime begun = now();
      outcome = co_await connect({address, settings_.port}, begun + (at - begun) / left--);
      if (outcome) break;
    }
    co_return outcome;
  }

  Result<Bytes> discard_input() override {
    if (!stream_.is_open()) return fail(ErrorCode::link_down, name_ + ": not connected");
    Bytes found;
    if (read_waiting(stream_.native_handle(), found) == 0) return found;
    close();
    return fail(ErrorCode::link_down, name_ + ": the peer closed the connection");
  }

  void close() noexcept override {
    lookup_.cancel();
    StreamTransport::close();
  }

 private:
  asio::awaitable<Result<void>> connect(tcp::endpoint endpoint, SteadyTime at) {
    close();
    deadline_.arm(at);
    asio::error_code error;
    stream_.open(endpoint.protocol(), error);
    if (!error && takes_from_others(stream_.native_handle())) error = asio::error::no_descriptors;
    if (!error) {
      const auto [failed] = co_await stream_.async_connect(endpoint, use_result);
      error = failed;
    }
    deadline_.disarm();
    if (error) {
      const std::string why = why_not_connected(error, deadline_.passed());
      close();
      co_return fail(ErrorCode::link_down, name_ + ": " + why);
    }
    asio::error_code ignored;
    stream_.non_blocking(true, ignored);
    stream_.set_option(tcp::no_delay(true), ignored);
    stream_.set_option(asio::socket_base::keep_alive(true), ignored);
    const int fd = stream_.native_handle();
    setsockopt(fd, IPPROTO_TCP, TCP_KEEPIDLE, &kKeepAliveIdleSeconds, sizeof(int));
    setsockopt(fd, IPPROTO_TCP, TCP_KEEPINTVL, &kKeepAliveIntervalSeconds, sizeof(int));
    setsockopt(fd, IPPROTO_TCP, TCP_KEEPCNT, &kKeepAliveProbes, sizeof(int));
    co_return Result<void>{};
  }

  const TcpSettings settings_;
  HostLookup lookup_;
};

}  // namespace

std::unique_ptr<Transport> make_tcp_transport(asio::any_io_executor executor,
                                              TcpSettings settings) {
  return std::make_unique<TcpTransport>(std::move(executor), std::move(settings));
}

}  // namespace fxagent
