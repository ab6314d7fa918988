#include "agent/uplink/paho/paho_inbox.h"

#include <utility>
#include <variant>

namespace fxagent {
namespace {

constexpr std::size_t kMaxInboxBytes = std::size_t{64} << 20;
// Size of the inbox above which QoS 0 messages are dropped. The broker sends them without flow
// control and never repeats them.
constexpr std::size_t kMaxUnaskedBytes = std::size_t{4} << 20;
constexpr std::size_t kFillingBytes = kMaxUnaskedBytes / 2;

}  // namespace

PahoInbox::PahoInbox(std::function<void()> notify) : notify_(std::move(notify)) {}

void PahoInbox::begin(std::uint64_t connection) {
  const std::lock_guard lock(mutex_);
  connection_ = connection;
  events_.clear();
  bytes_ = 0;
  dropped_ = 0;
}

void PahoInbox::await_acknowledgements(bool awaited) {
  {
    const std::lock_guard lock(mutex_);
    if (std::exchange(acknowledgements_awaited_, awaited) || !awaited || events_.empty()) return;
  }
  notify_();
}

void PahoInbox::post(std::uint64_t connection, BrokerEvent event) {
  {
    const std::lock_guard lock(mutex_);
    if (connection != connection_) return;
    if (const auto* message = std::get_if<Message>(&event)) {
      const std::size_t size = bytes_of(*message);
      if (bytes_ + size > (message->qos == 0 ? kMaxUnaskedBytes : kMaxInboxBytes)) {
        ++dropped_;
        return;
      }
      bytes_ += size;
    }
    const bool quiet = !acknowledgements_awaited_ && std::holds_alternative<Delivered>(event);
    events_.push_back(std::move(event));
    if (quiet) return;
  }
  notify_();
}

bool PahoInbox::is_filling() {
  const std::lock_guard lock(mutex_);
  return bytes_ > kFillingBytes;
}

std::vector<BrokerEvent> PahoInbox::take() {
  const std::lock_guard lock(mutex_);
  if (dropped_ != 0) events_.emplace_back(MessagesDropped{std::exchange(dropped_, 0)});
  bytes_ = 0;
  return std::exchange(events_, {});
}

}  // namespace fxagent
