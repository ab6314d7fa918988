#include "agent/process/heartbeats.h"

namespace fxagent {

std::string Heartbeats::stands_still() {
  const std::uint64_t field = field_;
  const std::uint64_t uplink = uplink_;
  const std::uint64_t pair = pair_;
  std::string who;
  const auto add = [&who](const char* name) {
    who += (who.empty() ? "" : " and ") + std::string(name);
  };
  if (field == field_then_) add("field");
  if (uplink == uplink_then_) add("uplink");
  if (has_pair_ && pair == pair_then_) add("pair");
  if (!who.empty()) return who;
  field_then_ = field;
  uplink_then_ = uplink;
  pair_then_ = pair;
  return {};
}

}  // namespace fxagent
