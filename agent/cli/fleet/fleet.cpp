#include "agent/cli/fleet/fleet.h"

#include <array>
#include <nlohmann/json.hpp>
#include <utility>

#include "agent/text/json.h"
#include "agent/text/sha256.h"
#include "agent/uplink/broker.h"

namespace fxagent {
namespace {

using SortedJson = nlohmann::json;
using Presence = FleetAgent::Presence;

constexpr std::string_view kState = "/state";
constexpr std::string_view kHealth = "/health";
constexpr std::array<std::string_view, 4> kTopics{kState, kHealth, kReportedTopic, kDesiredTopic};

std::optional<std::int64_t> time_at(const SortedJson& object, const char* key) {
  const SortedJson& value = member(object, key);
  if (!value.is_number_integer()) return std::nullopt;
  return value.get<std::int64_t>();
}

void take_state(FleetAgent& agent, const SortedJson& state) {
  const std::string word = text_at(state, "state");
  agent.presence = word == "online"    ? Presence::online
                   : word == "offline" ? Presence::offline
                                       : Presence::unknown;
  agent.since_ms = time_at(state, "since");
  agent.offline_reason = word == "offline" ? text_at(state, "reason") : "";
  agent.conflict = text_at(state, "conflict");
  agent.receives_commands = member(state, "commands") != SortedJson(false);
  if (std::string version = text_at(state, "version"); !version.empty())
    agent.version = std::move(version);
}

void take_health(FleetAgent& agent, const SortedJson& health) {
  agent.health_ms = time_at(health, "ts");
  agent.hash = text_at(member(health, "config"), "hash");
  if (agent.version.empty()) agent.version = text_at(health, "version");
}

FleetReport report_of(const SortedJson& said) {
  FleetReport report;
  report.state = text_at(said, "state");
  report.version = text_at(said, "version");
  report.desired_hash = text_at(said, "desired_hash");
  report.in_force = text_at(said, "in_force");
  report.hash = text_at(said, "hash");
  report.confirmed = member(said, "confirmed") == SortedJson(true);
  for (const SortedJson& error : member(said, "errors"))
    if (error.is_string()) report.errors.push_back(error.get<std::string>());
  return report;
}

}  // namespace

bool has_refused_another(const FleetAgent& agent) {
  if (!agent.desired || !agent.report || agent.report->state == "applied") return false;
  // A report on another document names the one in force only by its version.
  return agent.report->desired_hash != agent.desired->hash && !agent.report->in_force.empty() &&
         agent.report->in_force == agent.desired->version;
}

Agreement agreement_of(const FleetAgent& agent) {
  if (has_refused_another(agent))
    return agent.report->confirmed ? Agreement::as_asked : Agreement::on_trial;
  if (agent.desired && (!agent.report || agent.report->desired_hash != agent.desired->hash))
    return Agreement::no_answer;
  const std::string state = agent.report ? agent.report->state : "";
  if (state == "rejected") return Agreement::refused;
  if (state == "rolled_back") return Agreement::rolled_back;
  if (!agent.desired)
    return agent.report && !agent.report->desired_hash.empty() ? Agreement::unread
                                                               : Agreement::local_file;
  return agent.report->confirmed ? Agreement::as_asked : Agreement::on_trial;
}

bool is_as_asked(Agreement agreement) {
  return agreement != Agreement::refused && agreement != Agreement::rolled_back &&
         agreement != Agreement::no_answer;
}

std::vector<std::string> Fleet::filters(const std::vector<std::string>& names) const {
  std::vector<std::string> filters;
  for (const std::string_view topic : kTopics) {
    if (names.empty()) filters.push_back(root_ + "/+" + std::string(topic));
    for (const std::string& name : names)
      filters.push_back(root_ + "/" + name + std::string(topic));
  }
  return filters;
}

std::string Fleet::desired_topic(const std::string& name) const {
  return root_ + "/" + name + std::string(kDesiredTopic);
}

const FleetAgent& Fleet::agent(const std::string& name) const {
  static const FleetAgent unknown;
  const auto found = agents_.find(name);
  return found == agents_.end() ? unknown : found->second;
}

void Fleet::take(std::string_view topic, std::string_view payload) {
  if (!topic.starts_with(root_) || topic.substr(root_.size()).substr(0, 1) != "/") return;
  const std::string_view rest = topic.substr(root_.size() + 1);
  const std::size_t end = rest.find('/');
  if (end == 0 || end == rest.npos) return;
  const std::string name(rest.substr(0, end));
  const std::string_view kind = rest.substr(end);
  if (kind == kDesiredTopic) {
    if (payload.empty()) {
      if (const auto found = agents_.find(name); found != agents_.end())
        found->second.desired.reset();
      return;
    }
    const SortedJson document = parsed_json(payload);
    agents_[name].desired = {text_at(document, "version"), short_hash(payload)};
    return;
  }
  if (kind != kState && kind != kHealth && kind != kReportedTopic) return;
  const SortedJson said = parsed_json(payload);
  FleetAgent& agent = agents_[name];
  if (kind == kState) {
    take_state(agent, said);
  } else if (kind == kHealth) {
    take_health(agent, said);
  } else if (payload.empty()) {
    agent.report.reset();
  } else {
    agent.report = report_of(said);
    ++agent.reports;
  }
}

}  // namespace fxagent
