// `fxagent plan`: the reads that will be sent, the line time that they take, what the line can
// carry, and the bound that a command waits at the most. Pure but for its printing.
#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <vector>

#include "agent/config.h"

namespace fxagent {

/// One read of a group.
struct ExchangeReport {
  std::string address;  ///< of its first device
  std::uint32_t bytes = 0;
  std::optional<std::chrono::nanoseconds> line_time;  ///< nullopt: the line's speed is not known
};

/// Where a cycle's line time goes beside the values that somebody asked for.
struct Waste {
  std::chrono::nanoseconds framing{0};     ///< characters that every exchange has
  std::chrono::nanoseconds unasked{0};     ///< characters of bits between and beside the tags
  std::chrono::nanoseconds turnaround{0};  ///< the device's own time, gaps and rests
};

struct GroupReportLine {
  std::string device;
  std::string group;
  std::chrono::milliseconds interval{0};  ///< 0: as fast as the line allows
  std::vector<ExchangeReport> exchanges;
  std::optional<std::chrono::nanoseconds> line_time;
  Waste waste;
  /// With all groups of the link at this part of their intervals the line is full; nullopt where
  /// the group has no interval.
  std::optional<std::chrono::milliseconds> shortest_interval;
};

/// What smaller blocks would change for one device.
struct BlockTrade {
  std::string device;
  std::uint32_t max_block_bytes = 0;  ///< 0: what the protocol allows
  std::chrono::nanoseconds cycle{0};
  std::chrono::nanoseconds command_bound{0};
};

struct LinkReport {
  std::string name;
  std::optional<int> baud;
  std::optional<double> busy_percent;
  /// A write of one word with its read-back, beside the polls and with nothing queued before it.
  std::optional<std::chrono::nanoseconds> command_bound;
  std::vector<GroupReportLine> groups;
  std::vector<BlockTrade> block_trade;
  std::vector<std::string> warnings;
};

/// A link is as its config says; a device whose model is open counts as the widest.
std::vector<LinkReport> plan_links(const Config& config);

/// Adds the tags of "DEVICE FIRST..LAST@MS" (or "DEVICE ADDRESS@MS") to the device's group of that
/// interval, or to a new one named what-if. bad_request names what is wrong with it.
Result<void> add_what_if(Config& config, const std::string& what);

/// Prints the plan, and with `what_ifs` the plan after them too. Exit status 0, or 2 for a wrong
/// what-if.
int run_plan(const Config& config, const std::vector<std::string>& what_ifs, bool as_json);

}  // namespace fxagent
