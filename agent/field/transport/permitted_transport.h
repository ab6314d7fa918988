// Transport of a gateway in a pair: writes only while the permit lasts, and opens the channel only
// shortly before. Field thread only.
#pragma once

#include <asio/any_io_executor.hpp>
#include <asio/steady_timer.hpp>
#include <chrono>
#include <memory>
#include <optional>

#include "agent/field/transport/transport.h"
#include "agent/handover/line_permit.h"

namespace fxagent {

class PermittedTransport final : public Transport {
 public:
  /// `permit` outlives it. open() waits until `listening` before the permit opens, so that the
  /// link listens while the other gateway may still send.
  PermittedTransport(const asio::any_io_executor& executor, std::unique_ptr<Transport> channel,
                     const LinePermit& permit, std::chrono::nanoseconds listening)
      : timer_(executor), channel_(std::move(channel)), permit_(permit), listening_(listening) {}

  SteadyTime now() const override { return channel_->now(); }
  asio::awaitable<Result<void>> open(SteadyTime deadline) override;
  bool is_open() const override { return channel_->is_open(); }
  /// Error: link_down with `sent` 0 without a permit, or if another master was heard.
  asio::awaitable<Written> write(ByteView bytes, SteadyTime deadline) override;
  asio::awaitable<Result<std::size_t>> read_some(MutableBytes into, SteadyTime deadline) override;
  Result<Bytes> discard_input() override;
  bool has_datagrams() const override { return channel_->has_datagrams(); }
  bool has_rest() const override { return channel_->has_rest(); }
  bool can_renew() const override { return channel_->can_renew(); }
  Result<void> renew() override { return channel_->renew(); }
  void close() noexcept override;

 private:
  /// Bytes before the first request of this gateway are another master's, or the answer to one.
  void heard();

  asio::steady_timer timer_;
  const std::unique_ptr<Transport> channel_;
  const LinePermit& permit_;
  const std::chrono::nanoseconds listening_;
  bool closed_ = false;    ///< while open() waits
  bool has_sent_ = false;  ///< since the permit opened
  BootTime not_before_{};  ///< silence after bytes of another master
};

}  // namespace fxagent
