#include "agent/uplink/config_topics.h"

#include <utility>

namespace fxagent {

ConfigTopics::ConfigTopics(const Config& config, const Session& session, const Shutdown& shutdown,
                           RetainedState& retained, GuardedStore* store)
    : config_(config),
      session_(session),
      shutdown_(shutdown),
      retained_(retained),
      store_(store),
      topic_(config.base_topic() + std::string(kReportedTopic)) {}

void ConfigTopics::set_listener(Listener listener) { listener_ = std::move(listener); }

void ConfigTopics::report(std::string text, std::string audit) {
  report_ = std::move(text);
  if (session_.is_connected() && !shutdown_.has_begun()) retained_.config_report_is_due();
  if (!audit.empty() && store_ != nullptr) store_->journal().note(std::move(audit));
}

Publication ConfigTopics::take_report() {
  Publication publication = retained(topic_, report_.value_or(""));
  if (publication.payload.empty()) report_.reset();  // cleared once
  return publication;
}

void ConfigTopics::hear(const std::string& payload) const {
  if (config_.remote.enabled && listener_.desired && !shutdown_.has_begun())
    listener_.desired(payload);
}

void ConfigTopics::connection_began(SteadyTime now) {
  if (report_) retained_.config_report_is_due();
  if (listener_.connection) listener_.connection(true, now);
}

void ConfigTopics::connection_ended(SteadyTime now) {
  if (listener_.connection) listener_.connection(false, now);
}

}  // namespace fxagent
