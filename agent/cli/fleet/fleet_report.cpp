#include "agent/cli/fleet/fleet_report.h"

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <utility>

#include "agent/cli/report/layout.h"
#include "agent/text/json.h"
#include "agent/text/text.h"

namespace fxagent {
namespace {

using std::string_view_literals::operator""sv;

using OrderedJson = nlohmann::ordered_json;
using Outcome = Push::Outcome;
using Presence = FleetAgent::Presence;

/// Most reasons of one agent that the text lists. JSON has all.
constexpr std::size_t kMostReasons = 10;

constexpr const char* kUnread =
    "unread: config/desired could not be read, and the agent's report is shown; this user may have "
    "no right to it, or the broker has lost it\n";

constexpr const char* kNoReport =
    ", or nothing: the broker has no report of its config; is agent.remote_config set?";

/// Escapes text for the terminal, without the backslashes that JSON puts before quotes.
std::string plain(std::string_view text) {
  const std::string from = escaped(text, Escape::terminal);
  std::string out;
  for (std::size_t i = 0; i < from.size(); ++i) {
    if (from[i] == '\\' && i + 1 < from.size()) {
      if (from[++i] != '"') out += '\\';
    }
    out += from[i];
  }
  return out;
}

/// Returns "2026-11-21 08:30" in UTC.
std::string minute(std::int64_t ms) {
  std::string text = utc_text(ms);
  if (text.size() < 16 || text[10] != 'T') return text;
  text[10] = ' ';
  return text.substr(0, 16);
}

std::string state_text(const FleetAgent& agent) {
  if (agent.presence == Presence::unknown) return "unknown";
  std::string text = agent.presence == Presence::online ? "online" : "offline";
  if (!agent.offline_reason.empty()) text += ", " + plain(agent.offline_reason);
  if (agent.since_ms)
    text += " since " + minute(*agent.since_ms);
  else if (agent.health_ms)
    text += ", last health " + minute(*agent.health_ms);
  if (!agent.conflict.empty()) text += ", CONFLICT";
  if (!agent.receives_commands) text += ", no commands";
  return text;
}

/// Returns the config in force: "line2-v7 5f0c9a31".
std::string config_text(const FleetAgent& agent) {
  const std::string hash =
      agent.report && !agent.report->hash.empty() ? agent.report->hash : agent.hash;
  const std::string name =
      agent.report && !agent.report->in_force.empty() ? agent.report->in_force : "file";
  return plain(name) + (hash.empty() ? "" : " " + plain(hash.substr(0, 8)));
}

std::string_view word_of(Agreement agreement) {
  constexpr std::array kWords{"local_file"sv, "as_asked"sv,    "on_trial"sv, "unread"sv,
                              "refused"sv,    "rolled_back"sv, "no_answer"sv};
  static_assert(kWords.size() == static_cast<std::size_t>(Agreement::no_answer) + 1);
  return kWords[static_cast<std::size_t>(agreement)];
}

/// Returns the version of the document that an agreement is about; empty if it is not known.
std::string asked_version(const FleetAgent& agent) {
  if (agent.desired) return agent.desired->version;
  return agent.report ? agent.report->version : "";
}

std::string asked_text(const FleetAgent& agent) {
  const std::string version = asked_version(agent);
  return version.empty() ? "the document" : plain(version);
}

std::string agreement_text(const FleetAgent& agent) {
  switch (agreement_of(agent)) {
    case Agreement::local_file:
      return agent.presence == Presence::unknown ? "" : "nothing sent";
    case Agreement::as_asked:
      return "as sent";
    case Agreement::on_trial:
      return "as sent, on trial";
    case Agreement::unread:
      return asked_text(agent) + (agent.report->confirmed ? " applied" : " on trial") + ", unread";
    case Agreement::refused:
      return asked_text(agent) + " REFUSED";
    case Agreement::rolled_back:
      return asked_text(agent) + " ROLLED BACK";
    case Agreement::no_answer:
      return asked_text(agent) + " NOT ANSWERED";
  }
  return {};
}

std::string reasons(const std::vector<std::string>& why, const std::string& before) {
  std::string text;
  for (std::size_t i = 0; i < std::min(why.size(), kMostReasons); ++i)
    text += before + plain(why[i]) + "\n";
  if (why.size() > kMostReasons)
    text += before + "and " + std::to_string(why.size() - kMostReasons) + " more\n";
  return text;
}

std::string_view word_of(Outcome outcome) {
  constexpr std::array kWords{"not_sent"sv, "no_answer"sv,   "accepted"sv,
                              "refused"sv,  "not_allowed"sv, "no_answer"sv,
                              "on_trial"sv, "offline"sv,     "left_out"sv};
  static_assert(kWords.size() == static_cast<std::size_t>(Outcome::left_out) + 1);
  return kWords[static_cast<std::size_t>(outcome)];
}

std::string text_of(Outcome outcome) {
  if (outcome == Outcome::offline) return "offline, not sent";
  if (outcome == Outcome::left_out) return "offline, left out";
  std::string text(word_of(outcome));
  std::ranges::replace(text, '_', ' ');
  return text;
}

/// Returns the document that the agent has refused, with its reasons; empty: none.
std::string refusal_text(const std::string& name, const FleetAgent& agent) {
  const Agreement agreement = agreement_of(agent);
  const bool another = has_refused_another(agent);
  if (!another && agreement != Agreement::refused && agreement != Agreement::rolled_back) return {};
  const std::string& version = agent.report->version;
  return plain(name) + (agent.report->state == "rolled_back" ? " has rolled back " : " refuses ") +
         (version.empty() ? "the document" : plain(version)) +
         (another ? ", which the broker does not have" : "") + ":\n" +
         reasons(agent.report->errors, "  ");
}

bool is_agent_good(const FleetAgent& agent) {
  return agent.presence == Presence::online && agent.conflict.empty() &&
         is_as_asked(agreement_of(agent));
}

}  // namespace

bool is_fleet_good(const Fleet& fleet) {
  return !fleet.agents().empty() && std::ranges::all_of(fleet.agents(), [](const auto& entry) {
    return is_agent_good(entry.second);
  });
}

std::string fleet_text(const Fleet& fleet) {
  if (fleet.agents().empty())
    return "no agent was found: is --root right, and may this user read {root}/+/state?\n";
  std::vector<Row> rows{{"AGENT", "STATE", "VERSION", "CONFIG", "SENT"}};
  std::string refusals;
  std::size_t online = 0;
  std::size_t sent = 0;
  std::size_t as_asked = 0;
  std::size_t unread = 0;
  std::size_t without = 0;
  for (const auto& [name, agent] : fleet.agents()) {
    rows.push_back({plain(name), state_text(agent), plain(agent.version),
                    agent.presence == Presence::unknown && !agent.report ? "" : config_text(agent),
                    agreement_text(agent)});
    const Agreement agreement = agreement_of(agent);
    if (agent.presence == Presence::online) ++online;
    if (agreement == Agreement::unread) {
      ++unread;
    } else if (agreement != Agreement::local_file) {
      ++sent;
      if (is_as_asked(agreement)) ++as_asked;
    } else if (agent.presence != Presence::unknown) {
      ++without;
    }
    refusals += refusal_text(name, agent);
  }
  std::string sum =
      std::to_string(online) + " of " + std::to_string(fleet.agents().size()) + " online";
  if (sent > 0) sum += ", " + std::to_string(as_asked) + " of " + std::to_string(sent) + " as sent";
  if (unread > 0) sum += ", " + std::to_string(unread) + " unread";
  if (without > 0) sum += ", " + std::to_string(without) + " without a sent config";
  return table_text(rows) + refusals + (unread > 0 ? kUnread : "") + sum + "\n";
}

std::string fleet_json(const Fleet& fleet) {
  OrderedJson out;
  out["ok"] = is_fleet_good(fleet);
  out["error"] = nullptr;  // as in rollout_json(); a fault of the connection is on stderr alone
  auto& agents = out["agents"] = OrderedJson::array();
  for (const auto& [name, agent] : fleet.agents()) {
    OrderedJson one;
    one["agent"] = name;
    one["ok"] = is_agent_good(agent);
    one["state"] = agent.presence == Presence::online    ? "online"
                   : agent.presence == Presence::offline ? "offline"
                                                         : "unknown";
    one["since"] = or_null(agent.since_ms);
    one["reason"] = or_null(agent.offline_reason);
    one["conflict"] = or_null(agent.conflict);
    one["commands"] = agent.receives_commands;
    one["health_ts"] = or_null(agent.health_ms);
    one["version"] = or_null(agent.version);
    one["config_hash"] = or_null(agent.report ? agent.report->hash : agent.hash);
    one["in_force"] = or_null(agent.report ? agent.report->in_force : std::string());
    one["asked"] = or_null(asked_version(agent));
    one["config"] = word_of(agreement_of(agent));
    one["answered"] = or_null(agent.report ? agent.report->version : std::string());
    one["errors"] = agent.report ? agent.report->errors : std::vector<std::string>();
    agents.push_back(std::move(one));
  }
  return dumped(out) + "\n";
}

RolloutLines::RolloutLines(const Rollout& rollout) : rollout_(rollout) {
  for (const Push& push : rollout.pushes()) name_width_ = std::max(name_width_, push.agent.size());
}

std::string RolloutLines::take() {
  std::string lines;
  if (rollout_.batch() > batch_) {
    lines = decided_until(rollout_.begin());
    batch_ = rollout_.batch();
    lines += "batch " + std::to_string(batch_) + " of " + std::to_string(rollout_.batches()) + "\n";
  }
  return lines + decided_until(rollout_.pushes().size());
}

std::string RolloutLines::decided_until(std::size_t end) {
  std::string lines;
  for (std::size_t i = 0; i < end; ++i) {
    const Push& push = rollout_.pushes()[i];
    if (!push.is_decided() || !reported_.insert(i).second) continue;
    std::string name = plain(push.agent);
    name.resize(std::max(name.size(), name_width_), ' ');
    lines += "  " + name + "  " + text_of(push.outcome) + "\n" + reasons(push.why, "    ");
  }
  return lines;
}

std::string rollout_sum(const Rollout& rollout) {
  const std::vector<Push>& pushes = rollout.pushes();
  // "refused: edge1, edge2"
  const auto line = [&](const std::string& before, std::initializer_list<Outcome> outcomes) {
    std::string names;
    for (const Push& push : pushes)
      if (std::ranges::find(outcomes, push.outcome) != outcomes.end())
        names += (names.empty() ? before : ", ") + plain(push.agent);
    return names.empty() ? names : names + "\n";
  };
  const auto accepted = std::ranges::count(pushes, Outcome::accepted, &Push::outcome);
  const bool all_left_out =
      std::ranges::count(pushes, Outcome::left_out, &Push::outcome) == std::ssize(pushes);
  return (rollout.is_good() ? "done"
          : all_left_out    ? "NOTHING SENT"
                            : "STOPPED") +
         std::string(": ") + std::to_string(accepted) + " of " + std::to_string(pushes.size()) +
         " accepted\n" + line("accepted: ", {Outcome::accepted}) +
         line("refused: ", {Outcome::refused}) +
         line("not allowed by the broker: ", {Outcome::not_allowed}) +
         line("on trial: ", {Outcome::on_trial}) +
         line("no answer: ", {Outcome::silent, Outcome::waits}) +
         line("offline: ", {Outcome::offline, Outcome::left_out}) +
         line("not sent: ", {Outcome::not_sent});
}

std::string rollout_json(const Rollout& rollout, const std::string& error) {
  OrderedJson out;
  out["ok"] = error.empty() && rollout.is_good();
  out["error"] = or_null(error);
  auto& agents = out["agents"] = OrderedJson::array();
  for (const Push& push : rollout.pushes())
    agents.push_back({{"agent", push.agent},
                      {"version", push.version},
                      {"hash", push.hash},
                      {"outcome", word_of(push.outcome)},
                      {"why", push.why}});
  return dumped(out) + "\n";
}

std::string dry_run_text(const std::vector<Push>& pushes, const RolloutRules& rules,
                         const Fleet& fleet) {
  std::vector<Row> rows{{"BATCH", "AGENT", "STATE", "CONFIG", "WOULD GET"}};
  for (std::size_t i = 0; i < pushes.size(); ++i) {
    const Push& push = pushes[i];
    const FleetAgent& agent = fleet.agent(push.agent);
    const bool has_it =
        agent.report && agent.report->desired_hash == push.hash && agent.report->state == "applied";
    const bool is_unknown = agent.presence == Presence::online && !agent.report;
    rows.push_back({std::to_string(i / rules.batch + 1), plain(push.agent), state_text(agent),
                    agent.presence == Presence::unknown ? "" : config_text(agent),
                    plain(push.version) + (has_it       ? ", has it"
                                           : is_unknown ? kNoReport
                                                        : "")});
  }
  return table_text(rows);
}

bool is_dry_run_good(const std::vector<Push>& pushes, const RolloutRules& rules,
                     const Fleet& fleet) {
  bool is_any_online = false;
  for (const Push& push : pushes) {
    const FleetAgent& agent = fleet.agent(push.agent);
    const bool is_online = agent.presence == Presence::online;
    if (is_online ? !agent.report : !rules.skip_offline) return false;
    is_any_online = is_any_online || is_online;
  }
  return is_any_online;
}

}  // namespace fxagent
