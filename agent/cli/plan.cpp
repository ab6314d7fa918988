#include "agent/cli/subcommands.h"

#include <algorithm>
#include <cstdio>
#include <iostream>
#include <nlohmann/json.hpp>
#include <set>

#include "agent/cli/exit_status.h"
#include "agent/cli/report/layout.h"
#include "agent/cli/report/plan_report.h"
#include "agent/text/json.h"
#include "agent/text/text.h"

namespace fxagent {
namespace {

using std::chrono::nanoseconds;
using Json = nlohmann::ordered_json;
using Reports = std::vector<LinkReport>;

// Placeholder for a missing number.
const std::string kNone = "-";

// ---- JSON ---------------------------------------------------------------------------------------

Json time_json(const std::optional<nanoseconds>& duration) {
  return duration ? Json(rounded_ms(*duration)) : Json();
}

Json to_json(const ExchangeReport& exchange) {
  Json out{{"address", exchange.addresses.front()},
           {"bytes", exchange.bytes()},
           {"bits", exchange.bits},
           {"chars", exchange.chars},
           {"line_ms", time_json(exchange.line_time)}};
  if (exchange.gathered) out["addresses"] = exchange.addresses;
  return out;
}

Json to_json(const GroupLoad& group) {
  Json out;
  out["device"] = group.device;
  out["group"] = group.group;
  out["interval_ms"] = group.interval.count();
  out["line_ms"] = time_json(group.line_time);
  out["shortest_interval_ms"] =
      group.shortest_interval ? Json(group.shortest_interval->count()) : Json();
  out["takes_the_rest"] = group.interval.count() == 0;
  out["asked_ms"] = nullptr;
  out["waste_ms"] = nullptr;
  if (group.line_time) {
    out["asked_ms"] = rounded_ms(group.use.asked);
    out["waste_ms"] = {{"framing", rounded_ms(group.use.framing)},
                       {"unasked", rounded_ms(group.use.unasked)},
                       {"word_access", rounded_ms(group.use.word_access)},
                       {"turnaround", rounded_ms(group.use.turnaround)}};
  }
  out["exchanges"] = Json::array();
  for (const ExchangeReport& exchange : group.exchanges)
    out["exchanges"].push_back(to_json(exchange));
  return out;
}

Json to_json(const LinkReport& link) {
  Json out;
  out["name"] = link.name;
  out["baud"] = or_null(link.baud);
  out["busy_percent"] = link.busy_percent ? Json(tenth(*link.busy_percent)) : Json();
  out["command_bound_ms"] = time_json(link.command_bound);
  out["listening_ms"] = link.listening.count();
  out["groups"] = Json::array();
  for (const GroupLoad& group : link.groups) out["groups"].push_back(to_json(group));
  out["block_trade"] = Json::array();
  for (const BlockTrade& trade : link.block_trade)
    out["block_trade"].push_back({{"device", trade.device},
                                  {"max_block_bytes", trade.block_bytes},
                                  {"configured", trade.configured},
                                  {"cycle_ms", rounded_ms(trade.cycle)},
                                  {"command_bound_ms", time_json(trade.command_bound)}});
  out["warnings"] = link.warnings;
  return out;
}

Json to_json(const Reports& links) {
  Json out;
  out["links"] = Json::array();
  for (const LinkReport& link : links) out["links"].push_back(to_json(link));
  return out;
}

// ---- text ---------------------------------------------------------------------------------------

std::string number_text(double value) {
  char text[32];
  std::snprintf(text, sizeof(text), "%.1f", value);
  return text;
}

std::string time_text(const std::optional<nanoseconds>& duration) {
  return duration ? number_text(rounded_ms(*duration)) : kNone;
}

std::string with_unit(const std::optional<nanoseconds>& duration) {
  return duration ? time_text(duration) + " ms" : kNone;
}

std::string percent_text(const std::optional<double>& percent) {
  return percent ? number_text(*percent) + " %" : kNone;
}

std::string interval_text(std::chrono::milliseconds interval) {
  return interval.count() > 0 ? std::to_string(interval.count()) : "the rest";
}

void print_heading(const LinkReport& link) {
  std::cout << "link " << link.name << ", "
            << (link.baud ? std::to_string(*link.baud) + " baud" : std::string("unknown speed"));
}

std::string size_text(const ExchangeReport& exchange) {
  return exchange.bits % 8 == 0 ? counted(exchange.bytes(), "byte") : counted(exchange.bits, "bit");
}

void print_groups(const LinkReport& link) {
  std::vector<Row> rows{{"group", "every ms", "line ms", "at least ms", "data", "framing", "gaps",
                         "whole words", "waiting"}};
  for (const GroupLoad& group : link.groups) {
    const auto use = [&](nanoseconds part) {
      return group.line_time ? number_text(rounded_ms(part)) : kNone;
    };
    rows.push_back(
        {group.device + "/" + group.group, interval_text(group.interval),
         time_text(group.line_time),
         group.shortest_interval ? std::to_string(group.shortest_interval->count()) : kNone,
         use(group.use.asked), use(group.use.framing), use(group.use.unasked),
         use(group.use.word_access), use(group.use.turnaround)});
  }
  std::cout << table_text(rows, 1);
}

/// Returns "D100", or for places that share a frame "4 places: D100, D205, M16 …".
std::string places_text(const ExchangeReport& exchange) {
  constexpr std::size_t kShown = 4;
  const auto& all = exchange.addresses;
  if (!exchange.gathered) return all.front();
  std::string text = counted(all.size(), "place") + ": ";
  for (std::size_t i = 0; i < std::min(kShown, all.size()); ++i)
    text += (i > 0 ? ", " : "") + all[i];
  return text + (all.size() > kShown ? " ..." : "");
}

void print_reads(const LinkReport& link) {
  std::vector<Row> rows{{"read", "of", "size", "characters", "line ms"}};
  for (const GroupLoad& group : link.groups)
    for (const ExchangeReport& exchange : group.exchanges)
      rows.push_back({places_text(exchange), group.device + "/" + group.group, size_text(exchange),
                      std::to_string(exchange.chars), time_text(exchange.line_time)});
  std::cout << table_text(rows, 2);
}

/// Keeps one of adjacent sizes with equal results: the configured one, else the smallest.
std::vector<BlockTrade> without_repeats(const std::vector<BlockTrade>& trades) {
  std::vector<BlockTrade> kept;
  for (const BlockTrade& trade : trades) {
    const bool repeats = !kept.empty() && kept.back().device == trade.device &&
                         kept.back().cycle == trade.cycle &&
                         kept.back().command_bound == trade.command_bound;
    if (!repeats)
      kept.push_back(trade);
    else if (trade.configured)
      kept.back() = trade;
  }
  return kept;
}

/// Prints one line for each device, from large blocks to small ones.
void print_block_trade(const LinkReport& link) {
  const std::vector<BlockTrade> trades = without_repeats(link.block_trade);
  for (auto first = trades.begin(); first != trades.end();) {
    const auto end = std::find_if(first, trades.end(), [&](const BlockTrade& trade) {
      return trade.device != first->device;
    });
    const bool same = end - first == 1;
    std::cout << "  " << first->device << ": ";
    if (same) std::cout << "max_block_bytes has no effect here";
    for (auto trade = end; !same && trade-- != first;)
      std::cout << (trade + 1 == end ? "blocks of " : "; of ") << trade->block_bytes
                << (trade + 1 == end ? " bytes" : "") << (trade->configured ? " (now)" : "") << ": "
                << with_unit(trade->cycle) << (trade + 1 == end ? " a cycle" : "") << ", bound "
                << with_unit(trade->command_bound);
    std::cout << '\n';
    first = end;
  }
}

void print_plan(const Reports& links) {
  for (const LinkReport& link : links) {
    print_heading(link);
    if (link.busy_percent) std::cout << ", busy " << percent_text(link.busy_percent);
    if (link.command_bound)
      std::cout << "; a command takes at most " << with_unit(link.command_bound);
    std::cout << '\n';
    if (link.listening.count() > 0)
      std::cout << "  listens for " << link.listening.count() << " ms before its first request\n";
    if (!link.groups.empty()) {
      print_groups(link);
      print_reads(link);
    }
    print_block_trade(link);
    for (const std::string& warning : link.warnings) std::cout << "  warning: " << warning << '\n';
  }
}

/// Returns the group with the same names in an earlier report, or null.
const GroupLoad* same_group(const LinkReport& link, const GroupLoad& group) {
  const auto found = std::ranges::find_if(link.groups, [&](const GroupLoad& other) {
    return other.device == group.device && other.group == group.group;
  });
  return found == link.groups.end() ? nullptr : &*found;
}

/// Returns the cost of one cycle: its time, or its characters if the speed is unknown.
std::string cost_text(const GroupLoad& group) {
  if (group.line_time) return with_unit(group.line_time);
  std::uint32_t chars = 0;
  for (const ExchangeReport& exchange : group.exchanges) chars += exchange.chars;
  return counted(chars, "character");
}

/// Prints a comparison. A what-if only adds tags and groups, so `is` contains everything in `was`.
void print_change(const LinkReport& was, const LinkReport& is) {
  print_heading(is);
  std::cout << '\n';
  std::vector<Row> rows{
      {"", "before", "after"},
      {"busy", percent_text(was.busy_percent), percent_text(is.busy_percent)},
      {"a command takes at most", with_unit(was.command_bound), with_unit(is.command_bound)}};
  for (const GroupLoad& group : is.groups) {
    const GroupLoad* earlier = same_group(was, group);
    const std::string every = group.interval.count() > 0
                                  ? "every " + interval_text(group.interval) + " ms"
                                  : "as fast as possible";
    rows.push_back({group.device + "/" + group.group + ", " + every,
                    earlier != nullptr ? cost_text(*earlier) : kNone, cost_text(group)});
  }
  std::cout << table_text(rows, 1);
  for (const std::string& warning : was.warnings)
    std::cout << "  warning before: " << warning << '\n';
  for (const std::string& warning : is.warnings)
    std::cout << "  warning after: " << warning << '\n';
}

/// Returns the links that have more tags in `after`.
std::set<std::uint32_t> links_with_more(const Config& before, const Config& after) {
  std::set<std::uint32_t> links;
  for (std::size_t i = 0; i < after.devices.size(); ++i)
    if (after.devices[i].tags.size() > before.devices[i].tags.size())
      links.insert(after.devices[i].link);
  return links;
}

}  // namespace

int run_plan(const Config& config, const PlanQuestion& question) {
  Config changed = config;
  for (const std::string& what : question.what_ifs) {
    if (const auto added = add_what_if(changed, what); !added)
      return refused("--what-if", added.error().text);
  }
  const Reports before = plan_links(config);
  if (question.what_ifs.empty()) {
    if (question.as_json)
      std::cout << dumped(to_json(before)) << '\n';
    else
      print_plan(before);
    return kDone;
  }
  const Reports after = plan_links(changed);
  if (question.as_json)
    std::cout << dumped(Json({{"before", to_json(before)}, {"after", to_json(after)}})) << '\n';
  else
    for (const std::uint32_t link : links_with_more(config, changed))
      print_change(before[link], after[link]);
  return kDone;
}

}  // namespace fxagent
