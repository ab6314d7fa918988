#include "agent/process/heartbeats.h"

namespace fxagent {

std::string Heartbeats::stands_still() {
  const std::uint64_t field = field_;
  const std::uint64_t uplink = uplink_;
  std::string who;
  if (field == field_then_) who = "field";
  if (uplink == uplink_then_) who += who.empty() ? "uplink" : " and uplink";
  if (!who.empty()) return who;
  field_then_ = field;
  uplink_then_ = uplink;
  return {};
}

}  // namespace fxagent
