#include "agent/http/probe.h"

#include <algorithm>
#include <vector>

#include "agent/text/json_writer.h"
#include "agent/text/text.h"

namespace fxagent {
namespace {

using std::chrono::seconds;
using Reasons = std::vector<std::string>;

std::string text_of(SteadyTime::duration age) {
  return std::to_string(std::chrono::duration_cast<seconds>(age).count()) + " s";
}

Reasons faults(const AgentStatus* status, SteadyTime now) {
  if (status == nullptr) return {"uplink: no sign of life since the start"};
  // The uplink reports on the field: while it hangs, nothing is known of the field.
  if (is_stale(status, now))
    return {"uplink: no sign of life for " + text_of(now - status->made_at)};
  // Since the field's last report, or since the start if there was none.
  const auto silence = now - status->field_heard.value_or(status->made_at - status->uptime);
  if (silence > kFieldWithin) return {"field: no sign of life for " + text_of(silence)};
  return {};
}

/// Returns what the broker does not accept from this agent: "states", "samples of 2 devices".
/// Without a connection there is nothing.
Reasons refused_by_broker(const AgentStatus& status) {
  if (!status.broker.connected) return {};
  Reasons refused = status.broker.refused;
  const auto is_refused = [](const std::string& code) { return !code.empty(); };
  const auto devices =
      static_cast<std::uint64_t>(std::ranges::count_if(status.refused, is_refused));
  if (devices > 0) refused.push_back("samples of " + counted(devices, "device"));
  return refused;
}

Probe probe(const Reasons& reasons, const AgentStatus* status, SteadyTime now) {
  json::Writer out;
  out.begin_object().key("ok").boolean(reasons.empty()).key("why").begin_array();
  for (const std::string& reason : reasons) out.string(reason);
  out.end_array();
  if (status != nullptr) {
    out.key("boot").string(status->boot).key("version").string(status->version);
    // The status may be a minute old: without readers, a new one is rare.
    const auto age = std::chrono::duration_cast<seconds>(now - status->made_at);
    out.key("uptime_s").integer(static_cast<std::int64_t>((status->uptime + age).count()));
  }
  out.end_object();
  return {reasons.empty(), out.take() + "\n"};
}

}  // namespace

bool is_stale(const AgentStatus* status, SteadyTime now) {
  return status == nullptr || now - status->made_at > kUplinkWithin;
}

Probe health_of(const AgentStatus* status, SteadyTime now) {
  return probe(faults(status, now), status, now);
}

Probe readiness_of(const AgentStatus* status, SteadyTime now) {
  Reasons reasons = faults(status, now);
  if (reasons.empty()) {
    const BrokerStatus& broker = status->broker;
    if (!broker.connected)
      reasons.push_back("broker: no connection to " + broker.server +
                        (broker.why.empty() ? "" : ": " + broker.why));
    else if (!broker.subscribed)
      reasons.push_back("commands are not received: " + (broker.not_heard_why.empty()
                                                             ? "the broker has not confirmed yet"
                                                             : broker.not_heard_why));
    for (const std::string& what : refused_by_broker(*status))
      reasons.push_back("the broker refuses " + what + ": see the log");
    if (!status->conflict.empty())
      reasons.push_back("commands are refused: another agent has the same id, boot " +
                        status->conflict);
  }
  return probe(reasons, status, now);
}

}  // namespace fxagent
