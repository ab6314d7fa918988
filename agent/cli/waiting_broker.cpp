#include "agent/cli/waiting_broker.h"

#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <stdexcept>

#include "agent/without_signals.h"

namespace fxagent {

WaitingBroker::WaitingBroker(const MqttConfig& config, std::size_t max_payload,
                             const SettingNames& names, std::chrono::seconds keep_session)
    : news_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)),
      signals_(stop_descriptor()),
      broker_(
          config, /*make_will=*/{},
          [this] {
            const std::uint64_t one = 1;
            // Fails only if the counter is full, and then an event is pending anyway.
            [[maybe_unused]] const auto written = write(news_, &one, sizeof one);
          },
          max_payload, keep_session, names) {
  if (news_ < 0 || signals_ < 0) throw std::runtime_error("no free file handle");
}

bool WaitingBroker::wait_until(SteadyTime deadline) {
  const auto left =
      std::chrono::ceil<std::chrono::milliseconds>(deadline - std::chrono::steady_clock::now())
          .count();
  if (left <= 0) return true;
  pollfd waited[] = {{news_, POLLIN, 0}, {signals_, POLLIN, 0}};
  poll(waited, 2, static_cast<int>(std::min<std::int64_t>(left, 3'600'000)));
  if (waited[1].revents != 0) return false;
  std::uint64_t count = 0;
  [[maybe_unused]] const auto read_bytes = read(news_, &count, sizeof count);
  return true;
}

}  // namespace fxagent
