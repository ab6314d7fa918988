#include "agent/process/service_reports.h"

#include <utility>

#include "agent/log/log.h"
#include "agent/process/service_manager.h"

namespace fxagent {

std::string Heartbeats::hanging_threads() {
  constexpr std::array<const char*, kThreadCount> kNames{"field", "uplink", "pair"};  // as Thread
  std::array<std::uint64_t, kThreadCount> now{};
  std::string who;
  for (std::size_t i = 0; i < threads_; ++i) {
    now[i] = signs_[i];
    if (now[i] == then_[i]) who += (who.empty() ? "" : " and ") + std::string(kNames[i]);
  }
  if (who.empty()) then_ = now;
  return who;
}

ServiceReports::ServiceReports(Heartbeats& signs, Sources sources, Time now)
    : signs_(signs),
      sources_(std::move(sources)),
      feed_every_(service_manager::watchdog_interval()) {
  if (feed_every_) {
    feed_at_ = now + *feed_every_;
    sources_.ask();
  }
  if (service_manager::is_there()) status_at_ = now;
}

void ServiceReports::keep(Time now) {
  if (now >= feed_at_) feed(now);
  if (now >= status_at_) notify_status(now);
}

void ServiceReports::feed(Time now) {
  feed_at_ = now + *feed_every_;
  const std::string hanging = signs_.hanging_threads();
  if (hanging.empty()) {
    service_manager::notify_alive();
  } else if (hanging != hanging_threads_) {
    log::error("watchdog", {{"stands_still", hanging}});
    status_at_ = now;
  }
  hanging_threads_ = hanging;
  sources_.ask();
}

void ServiceReports::notify_status(Time now) {
  status_at_ = now + kStatusEvery;
  std::string status = hanging_threads_.empty()
                           ? sources_.status()
                           : hanging_threads_ + " hangs: systemd must restart the agent";
  // A repetition is needed because other parts send a status too, such as the outcome of a reload.
  if (status.empty() || (status == status_ && now < sent_at_ + kSameStatusEvery)) return;
  service_manager::notify_status(status);
  sent_at_ = now;
  status_ = std::move(status);
}

}  // namespace fxagent
