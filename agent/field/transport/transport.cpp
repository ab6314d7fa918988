#include "agent/field/transport/transport.h"

#include <algorithm>
#include <asio/steady_timer.hpp>
#include <utility>
#include <variant>

#include "agent/field/transport/stream_io.h"
#include "agent/handover/line_permit.h"

namespace fxagent {
namespace {

/// Transport of a gateway in a pair: writes only while the permit lasts, and opens the channel only
/// shortly before.
class PermittedTransport final : public Transport {
 public:
  /// open() waits until `listening` before the permit opens, so that the link listens while the
  /// other gateway may still send.
  PermittedTransport(const asio::any_io_executor& executor, std::unique_ptr<Transport> channel,
                     const LinePermit& permit, std::chrono::nanoseconds listening)
      : timer_(executor), channel_(std::move(channel)), permit_(permit), listening_(listening) {}

  SteadyTime now() const override { return channel_->now(); }

  asio::awaitable<Result<void>> open(SteadyTime deadline) override {
    closed_ = false;
    const auto wait = std::max(permit_.opens_at(), not_before_) - listening_ - boot_time_now();
    if (wait > std::chrono::nanoseconds(0)) {
      timer_.expires_after(wait);
      co_await timer_.async_wait(use_result);
      deadline += wait;
      if (closed_) co_return fail(ErrorCode::link_down, "closed while it waited for the pair");
    }
    // A serial server may accept one connection only: it is the holder's.
    if (!permit_.holds(boot_time_now())) co_return fail(ErrorCode::link_down, kNotConfirmed);
    co_return co_await channel_->open(deadline);
  }

  bool is_open() const override { return channel_->is_open(); }

  asio::awaitable<Written> write(ByteView bytes, SteadyTime deadline) override {
    const BootTime at = boot_time_now();
    if (at < not_before_)
      co_return not_permitted("another master was heard; this gateway waits for silence");
    if (!permit_.may_send(at)) co_return not_permitted(kNotConfirmed);
    has_sent_ = true;
    co_return co_await channel_->write(bytes, deadline);
  }

  asio::awaitable<Result<std::size_t>> read_some(MutableBytes into, SteadyTime deadline) override {
    auto got = co_await channel_->read_some(into, deadline);
    if (got) received();
    co_return got;
  }

  Result<Bytes> discard_input() override {
    auto found = channel_->discard_input();
    if (found && !found->empty()) received();
    return found;
  }

  bool has_datagrams() const override { return channel_->has_datagrams(); }
  bool has_rest() const override { return channel_->has_rest(); }
  bool can_renew() const override { return channel_->can_renew(); }
  Result<void> renew() override { return channel_->renew(); }

  void close() noexcept override {
    closed_ = true;
    timer_.cancel();
    channel_->close();
  }

 private:
  static constexpr auto kNotConfirmed =
      "the broker does not confirm that this gateway is the active one";

  static Written not_permitted(const char* why) { return {0, Error{ErrorCode::link_down, why}}; }

  /// Bytes before the first request of this gateway are another master's, or the answer to one.
  void received() {
    if (!has_sent_) not_before_ = boot_time_now() + permit_.quiet();
  }

  asio::steady_timer timer_;
  const std::unique_ptr<Transport> channel_;
  const LinePermit& permit_;
  const std::chrono::nanoseconds listening_;
  bool closed_ = false;    ///< while open() waits
  bool has_sent_ = false;  ///< since the permit opened
  BootTime not_before_{};  ///< silence after bytes of another master
};

}  // namespace

std::unique_ptr<Transport> make_transport(const asio::any_io_executor& executor,
                                          const LinkConfig& link, const LinePermit* permit) {
  if (permit != nullptr)
    return std::make_unique<PermittedTransport>(executor, make_transport(executor, link), *permit,
                                                link.listening);
  if (const auto* serial = std::get_if<SerialSettings>(&link.channel))
    return make_serial_transport(executor, *serial);
  if (const auto* udp = std::get_if<UdpSettings>(&link.channel))
    return make_udp_transport(executor, *udp);
  return make_tcp_transport(executor, std::get<TcpSettings>(link.channel));
}

}  // namespace fxagent
