#include "agent/field/bus/channel.h"

#include <algorithm>
#include <string_view>
#include <utility>

#include "agent/field/bus/overheard.h"

namespace fxagent {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;

constexpr milliseconds kOpenTimeout{5000};
// A serial server delivers what it has buffered at once or not at all.
constexpr milliseconds kQuietAfterOpen{50};
// The channel is closed if the line is not quiet after this time.
constexpr milliseconds kLongestDrain{3000};
constexpr std::size_t kReadChunk = 512;
constexpr std::string_view kNeverSilent =
    "bytes arrive without a pause (another master, noise, or wrong settings?)";

}  // namespace

asio::awaitable<Channel::Received> Channel::open(nanoseconds listening) {
  answered_ = closed_unanswered_ = closed_after_silence_ = false;
  why_lost_ = "the line was lost";
  const auto opened = co_await transport_->open(transport_->now() + kOpenTimeout);
  Received received;
  if (!opened) {
    received.error = opened.error();
  } else {
    ++session_;
    // A serial server delivers a late answer to the current connection. A PLC on a serial port
    // answers whichever program has it open. An earlier program may have sent its last request just
    // now. Answers to another port do not reach this one.
    if (!transport_->can_renew())
      received = co_await listen(transport_->now() + listening, kQuietAfterOpen);
  }
  open_ended_ = transport_->now();
  co_return received;
}

asio::awaitable<Channel::Received> Channel::listen(SteadyTime until, nanoseconds quiet) {
  const auto now = [this] { return transport_->now(); };
  const auto give_up = std::max(until, now() + quiet) + kLongestDrain;
  std::uint8_t chunk[kReadChunk];
  Received received;
  for (;;) {
    const auto got = co_await transport_->read_some(chunk, std::max(until, now() + quiet));
    if (!got && got.error().code == ErrorCode::timeout) co_return received;
    if (!got) {
      lose(got.error().text);
      received.error = got.error();
      co_return received;
    }
    received.total += *got;
    if (received.bytes.size() < Overheard::kMostJudged)
      received.bytes.insert(received.bytes.end(), chunk, chunk + *got);
    if (received.total < kMostDrained && now() < give_up) continue;
    close_never_silent();
    received.error = Error{ErrorCode::link_down, why_lost_};
    co_return received;
  }
}

void Channel::lose(std::string why) {
  transport_->close();
  closed_unanswered_ = !answered_;
  why_lost_ = std::move(why);
}

void Channel::close_after_silence() {
  closed_after_silence_ = true;
  transport_->close();
}

void Channel::close_never_silent() {
  transport_->close();
  never_silent_ = true;
  why_lost_ = kNeverSilent;
}

}  // namespace fxagent
