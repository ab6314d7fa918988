#include "agent/field/transport/permitted_transport.h"

#include <algorithm>
#include <utility>

#include "agent/field/transport/stream_io.h"

namespace fxagent {
namespace {

Transport::Written not_permitted(const char* why) {
  Transport::Written none;
  none.error = Error{ErrorCode::link_down, why};
  return none;
}

}  // namespace

asio::awaitable<Result<void>> PermittedTransport::open(SteadyTime deadline) {
  closed_ = false;
  const auto wait = std::max(permit_.opens_at(), not_before_) - listening_ - boot_time_now();
  if (wait > std::chrono::nanoseconds(0)) {
    timer_.expires_after(wait);
    co_await timer_.async_wait(use_result);
    deadline += wait;
    if (closed_) co_return fail(ErrorCode::link_down, "closed while it waited for the pair");
  }
  // A serial server may accept one connection only: it is the holder's.
  if (!permit_.holds(boot_time_now()))
    co_return fail(ErrorCode::link_down,
                   "the broker does not confirm that this gateway is the active one");
  co_return co_await channel_->open(deadline);
}

asio::awaitable<Transport::Written> PermittedTransport::write(ByteView bytes, SteadyTime deadline) {
  const BootTime at = boot_time_now();
  if (at < not_before_)
    co_return not_permitted("another master was heard; this gateway waits for silence");
  if (!permit_.may_send(at))
    co_return not_permitted("the broker does not confirm that this gateway is the active one");
  has_sent_ = true;
  co_return co_await channel_->write(bytes, deadline);
}

asio::awaitable<Result<std::size_t>> PermittedTransport::read_some(MutableBytes into,
                                                                   SteadyTime deadline) {
  auto got = co_await channel_->read_some(into, deadline);
  if (got) heard();
  co_return got;
}

Result<Bytes> PermittedTransport::discard_input() {
  auto found = channel_->discard_input();
  if (found && !found->empty()) heard();
  return found;
}

void PermittedTransport::heard() {
  if (!has_sent_) not_before_ = boot_time_now() + permit_.quiet();
}

void PermittedTransport::close() noexcept {
  closed_ = true;
  timer_.cancel();
  channel_->close();
}

}  // namespace fxagent
