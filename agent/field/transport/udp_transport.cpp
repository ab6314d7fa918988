#include "agent/field/transport/transport.h"

#include <sys/socket.h>

#include <algorithm>
#include <asio/ip/udp.hpp>
#include <cerrno>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "agent/field/transport/host_lookup.h"
#include "agent/field/transport/stream_io.h"

namespace fxagent {
namespace {

using asio::ip::udp;

// No frame is longer; the rest of a longer datagram is lost.
constexpr std::size_t kLongestDatagram = 8192;

class UdpTransport final : public Transport {
 public:
  UdpTransport(asio::any_io_executor executor, UdpSettings settings)
      : settings_(std::move(settings)),
        name_(settings_.host + ":" + std::to_string(settings_.port)),
        socket_(executor),
        deadline_(executor, socket_) {}

  asio::awaitable<Result<void>> open(SteadyTime at) override {
    close();
    const auto found = co_await lookup_.find(socket_.get_executor(), settings_.host, name_, at);
    if (!found) co_return fail(found);
    endpoint_ = {address_of(*found), settings_.port};
    answered_ = false;
    co_return take_port();
  }

  bool is_open() const override { return socket_.is_open(); }
  bool has_datagrams() const override { return true; }
  bool has_rest() const override { return given_ < datagram_.size(); }
  bool can_renew() const override { return settings_.local_port == 0; }

  Result<void> renew() override {
    if (!asked_ || !can_renew()) return {};
    return take_port();
  }

  asio::awaitable<Written> write(ByteView bytes, SteadyTime at) override {
    Written written;
    deadline_.arm(at);
    auto [error, count] = send(bytes);
    while (error == asio::error::would_block) {
      const auto [failed] = co_await socket_.async_wait(udp::socket::wait_write, use_result);
      if (failed)
        error = failed;
      else
        std::tie(error, count) = send(bytes);
    }
    deadline_.disarm();
    written.sent = count;
    asked_ = asked_ || count > 0;
    if (!error) co_return written;
    const bool is_late = error == asio::error::operation_aborted && deadline_.passed();
    written.error =
        Error{ErrorCode::link_down,
              name_ + ": " + (is_late ? "the socket accepts no more bytes" : why(error))};
    co_return written;
  }

  asio::awaitable<Result<std::size_t>> read_some(MutableBytes into, SteadyTime at) override {
    deadline_.arm(at);
    asio::error_code error;
    // An empty datagram is not an answer, and a stream of them must not extend the wait.
    bool is_empty = false;
    while (!has_rest() && !error) {
      const bool is_over = is_empty && now() >= at;
      if (is_over) {
        deadline_.disarm();
        co_return fail(ErrorCode::timeout, "no answer on " + name_);
      }
      error = receive();
      is_empty = !error;
      if (error != asio::error::would_block) continue;
      const auto [failed] = co_await socket_.async_wait(udp::socket::wait_read, use_result);
      error = failed;
    }
    deadline_.disarm();
    if (!error) {
      answered_ = true;
      co_return give(into);
    }
    if (error == asio::error::operation_aborted && deadline_.passed())
      co_return fail(ErrorCode::timeout, "no answer on " + name_);
    co_return fail(ErrorCode::link_down, name_ + ": " + why(error));
  }

  Result<Bytes> discard_input() override {
    if (!socket_.is_open()) return fail(ErrorCode::link_down, name_ + ": not open");
    Bytes found(datagram_.begin() + static_cast<std::ptrdiff_t>(given_), datagram_.end());
    forget_datagram();
    std::size_t taken = found.size();  // plus one for each empty datagram
    while (taken < kMostDiscarded) {
      const asio::error_code error = receive();
      if (error == asio::error::would_block) break;
      if (error) {
        close();
        return fail(ErrorCode::link_down, name_ + ": " + why(error));
      }
      found.insert(found.end(), datagram_.begin(), datagram_.end());
      taken += std::max<std::size_t>(datagram_.size(), 1);
      forget_datagram();
    }
    return found;
  }

  void close() noexcept override {
    lookup_.cancel();
    deadline_.cancel();
    asio::error_code ignored;
    if (socket_.is_open()) socket_.close(ignored);
    forget_datagram();
  }

 private:
  /// Returns the address that has answered, while the name still has it; otherwise the one after
  /// the last.
  asio::ip::address address_of(const std::vector<asio::ip::address>& found) const {
    const auto last = std::ranges::find(found, endpoint_.address());
    if (last == found.end()) return found.front();
    if (answered_) return *last;
    return last + 1 == found.end() ? found.front() : *(last + 1);
  }

  Result<void> take_port() {
    // The old socket is closed afterwards, or the new one might get the same port.
    udp::socket taken(socket_.get_executor());
    asio::error_code error;
    taken.open(endpoint_.protocol(), error);
    if (!error && takes_from_others(taken.native_handle())) error = asio::error::no_descriptors;
    if (!error) taken.non_blocking(true, error);
    if (!error && settings_.local_port != 0)
      taken.bind({endpoint_.protocol(), settings_.local_port}, error);
    const bool is_taken = error == asio::error::address_in_use;
    if (!error) taken.connect(endpoint_, error);
    close();
    asked_ = false;
    if (!error) socket_ = std::move(taken);
    // Before it was connected, any sender could reach it.
    if (!error && !discard_input()) error = asio::error::connection_refused;
    if (!error) return {};
    close();
    return fail(ErrorCode::link_down,
                is_taken
                    ? name_ + ": another program uses the local_port " +
                          std::to_string(settings_.local_port) +
                          ", or another agent; end it, or set another port here and in the device"
                    : name_ + ": " + why(error));
  }

  std::pair<asio::error_code, std::size_t> send(ByteView bytes) {
    asio::error_code error;
    const std::size_t count = socket_.send(asio::buffer(bytes.data(), bytes.size()), 0, error);
    return {error, error ? 0 : count};
  }

  /// Receives the next whole datagram into datagram_.
  asio::error_code receive() {
    forget_datagram();
    std::uint8_t bytes[kLongestDatagram];
    const auto count = ::recv(socket_.native_handle(), bytes, sizeof bytes, MSG_DONTWAIT);
    if (count < 0 && errno == EINTR) return {};
    if (count < 0) return {errno, asio::error::get_system_category()};
    datagram_.assign(bytes, bytes + count);
    return {};
  }

  std::size_t give(MutableBytes into) {
    const std::size_t count = std::min(into.size(), datagram_.size() - given_);
    std::copy_n(datagram_.begin() + static_cast<std::ptrdiff_t>(given_), count, into.begin());
    given_ += count;
    return count;
  }

  void forget_datagram() noexcept {
    datagram_.clear();
    given_ = 0;
  }

  static std::string why(const asio::error_code& error) {
    if (error == asio::error::connection_refused)
      return "the device has no such UDP port (ICMP port unreachable): is it the right port, and "
             "is that port set to UDP?";
    return why_failed(error);
  }

  const UdpSettings settings_;
  const std::string name_;
  HostLookup lookup_;
  udp::endpoint endpoint_;
  bool answered_ = false;  ///< the endpoint has sent something since open()
  bool asked_ = false;     ///< something was sent from this port
  Bytes datagram_;
  std::size_t given_ = 0;  ///< bytes of it already read
  udp::socket socket_;
  Deadline<udp::socket> deadline_;
};

}  // namespace

std::unique_ptr<Transport> make_udp_transport(asio::any_io_executor executor,
                                              UdpSettings settings) {
  return std::make_unique<UdpTransport>(std::move(executor), std::move(settings));
}

}  // namespace fxagent
