#include "agent/field/tcp_transport.h"

#include <netinet/tcp.h>
#include <sys/resource.h>
#include <sys/socket.h>

#include <asio/ip/tcp.hpp>
#include <asio/steady_timer.hpp>
#include <cerrno>
#include <memory>
#include <utility>

#include "agent/field/stream_io.h"

namespace fxagent {
namespace {

using asio::ip::tcp;

// A cable pulled between two polls is noticed within about 20 s even where nobody speaks.
constexpr int kKeepAliveIdleSeconds = 10;
constexpr int kKeepAliveIntervalSeconds = 3;
constexpr int kKeepAliveProbes = 3;

/// The kernel gives the lowest number that is free. Links that took every one would keep the broker
/// and the store from coming back.
bool takes_from_others(int fd) {
  rlimit limit{};
  return getrlimit(RLIMIT_NOFILE, &limit) == 0 &&
         static_cast<rlim_t>(fd) + kFilesNotForLinks >= limit.rlim_cur;
}

/// A name lookup that nobody need wait for: the system's takes as long as it likes and cannot be
/// cancelled. Owned by who waits for it and by the lookup itself, whichever lasts longer.
struct Lookup {
  explicit Lookup(const asio::any_io_executor& executor) : resolver(executor), over(executor) {}
  tcp::resolver resolver;
  asio::steady_timer over;  ///< cancelled when the answer is here, or when nobody wants it any more
  bool answered = false;
  asio::error_code error;
  tcp::resolver::results_type found;
};

class TcpTransport final : public Transport {
 public:
  TcpTransport(asio::any_io_executor executor, TcpSettings settings)
      : settings_(std::move(settings)),
        name_(settings_.host + ":" + std::to_string(settings_.port)),
        socket_(executor),
        deadline_(executor, socket_) {}

  asio::awaitable<Result<void>> open(SteadyTime at) override {
    close();
    asio::error_code not_numeric;
    const auto address = asio::ip::make_address(settings_.host, not_numeric);
    if (!not_numeric) {
      const tcp::endpoint endpoint(address, settings_.port);
      co_return co_await connect(endpoint, at);
    }
    const auto lookup = std::make_shared<Lookup>(socket_.get_executor());
    lookup_ = lookup;
    lookup->over.expires_at(at);
    lookup->resolver.async_resolve(
        settings_.host, std::to_string(settings_.port),
        [lookup](const asio::error_code& error, tcp::resolver::results_type found) {
          lookup->answered = true;
          lookup->error = error;
          lookup->found = std::move(found);
          lookup->over.cancel();
        });
    co_await lookup->over.async_wait(use_result);
    lookup_.reset();
    if (!lookup->answered)
      co_return fail(ErrorCode::link_down, name_ + ": the lookup of the name has no answer");
    if (lookup->error)
      co_return fail(ErrorCode::link_down,
                     name_ + ": the name is not found: " + lookup->error.message());
    Result<void> outcome = fail(ErrorCode::link_down, name_ + ": the name has no address");
    for (const auto& entry : lookup->found) {
      const tcp::endpoint endpoint = entry.endpoint();
      outcome = co_await connect(endpoint, at);
      if (outcome) break;
    }
    co_return outcome;
  }

  bool is_open() const override { return socket_.is_open(); }

  asio::awaitable<Written> write(ByteView bytes, SteadyTime at) override {
    return write_all(socket_, deadline_, bytes, at, name_);
  }

  asio::awaitable<Result<std::size_t>> read_some(MutableBytes into, SteadyTime at) override {
    return fxagent::read_some(socket_, deadline_, into, at, name_);
  }

  Result<Bytes> discard_input() override {
    Bytes found;
    std::uint8_t waste[512];
    while (found.size() < kMostDiscarded) {
      if (!socket_.is_open()) return fail(ErrorCode::link_down, name_ + ": not connected");
      const auto count = ::recv(socket_.native_handle(), waste, sizeof waste, MSG_DONTWAIT);
      if (count > 0) {
        found.insert(found.end(), waste, waste + count);
      } else if (count < 0 && (errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR)) {
        return found;
      } else {
        close();
        return fail(ErrorCode::link_down, name_ + ": the peer closed the connection");
      }
    }
    return found;
  }

  void close() noexcept override {
    if (lookup_) lookup_->over.cancel();
    deadline_.cancel();
    asio::error_code ignored;
    if (socket_.is_open()) socket_.close(ignored);
  }

 private:
  asio::awaitable<Result<void>> connect(tcp::endpoint endpoint, SteadyTime at) {
    close();
    deadline_.arm(at);
    asio::error_code error;
    socket_.open(endpoint.protocol(), error);
    if (!error && takes_from_others(socket_.native_handle())) error = asio::error::no_descriptors;
    if (!error) {
      const auto [failed] = co_await socket_.async_connect(endpoint, use_result);
      error = failed;
    }
    deadline_.disarm();
    if (error) {
      const std::string why = deadline_.passed() ? "no answer to the connection" : error.message();
      close();
      co_return fail(ErrorCode::link_down, name_ + ": " + why);
    }
    asio::error_code ignored;
    socket_.non_blocking(true, ignored);
    socket_.set_option(tcp::no_delay(true), ignored);
    socket_.set_option(asio::socket_base::keep_alive(true), ignored);
    const int fd = socket_.native_handle();
    setsockopt(fd, IPPROTO_TCP, TCP_KEEPIDLE, &kKeepAliveIdleSeconds, sizeof(int));
    setsockopt(fd, IPPROTO_TCP, TCP_KEEPINTVL, &kKeepAliveIntervalSeconds, sizeof(int));
    setsockopt(fd, IPPROTO_TCP, TCP_KEEPCNT, &kKeepAliveProbes, sizeof(int));
    co_return Result<void>{};
  }

  const TcpSettings settings_;
  const std::string name_;
  std::shared_ptr<Lookup> lookup_;  ///< under way
  tcp::socket socket_;
  Deadline<tcp::socket> deadline_;
};

}  // namespace

void start_looking_up(const asio::any_io_executor& executor) {
  tcp::resolver resolver(executor);
  resolver.async_resolve("127.0.0.1", "0",
                         tcp::resolver::numeric_host | tcp::resolver::numeric_service,
                         [](const asio::error_code&, const tcp::resolver::results_type&) {});
}

std::unique_ptr<Transport> make_tcp_transport(asio::any_io_executor executor,
                                              TcpSettings settings) {
  return std::make_unique<TcpTransport>(std::move(executor), std::move(settings));
}

}  // namespace fxagent
