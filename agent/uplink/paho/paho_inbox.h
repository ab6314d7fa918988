// Events from Paho's threads to the uplink thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <mutex>
#include <vector>

#include "agent/uplink/broker.h"

namespace fxagent {

/// Any thread. Bounded: excess messages are dropped and counted; every other event comes at most
/// once per call of ours.
class PahoInbox final {
 public:
  /// `notify` is called when there are events, on the thread that posts them.
  explicit PahoInbox(std::function<void()> notify);

  /// Discards all waiting events. Accepts only events of this connection afterwards.
  void begin(std::uint64_t connection);
  /// Sets if Delivered calls notify(). When switched on, notifies at once if events are waiting.
  void await_acknowledgements(bool awaited);
  void post(std::uint64_t connection, BrokerEvent event);
  /// True if more messages wait than an uplink that has the CPU leaves. Do not read more then.
  bool is_filling();
  std::vector<BrokerEvent> take();

 private:
  const std::function<void()> notify_;
  std::mutex mutex_;
  std::uint64_t connection_ = 0;
  std::vector<BrokerEvent> events_;
  std::size_t bytes_ = 0;
  std::uint64_t dropped_ = 0;
  bool acknowledgements_awaited_ = true;
};

}  // namespace fxagent
