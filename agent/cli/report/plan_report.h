// Analysis of a config for `fxagent plan`: the reads to be sent, their bus time and its breakdown,
// the capacity of the bus, and the bound of commands. Pure.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "agent/config/model.h"

namespace fxagent {

/// One exchange of a group's cycle.
struct ExchangeReport {
  /// First device of each place that it reads: one place, or several that share a frame.
  std::vector<std::string> addresses;
  bool gathered = false;    ///< read with a command for several places
  std::uint32_t bits = 0;   ///< of all places
  std::uint32_t chars = 0;  ///< on the wire in both directions, including an enquiry before it
  /// Characters, turnaround, gap and rest; nullopt: the bus speed is unknown.
  std::optional<std::chrono::nanoseconds> line_time;

  std::uint32_t bytes() const { return (bits + 7) / 8; }
};

/// Breakdown of the bus time of a cycle. The parts add up to the whole.
struct LineTimeUse {
  std::chrono::nanoseconds asked{0};    ///< characters of the data that the tags need
  std::chrono::nanoseconds framing{0};  ///< fixed characters of an exchange, whatever it reads
  std::chrono::nanoseconds unasked{0};  ///< characters of gaps and of alignment
  /// Bits of bit devices that are read only because the protocol reads whole bytes or words.
  std::chrono::nanoseconds word_access{0};
  std::chrono::nanoseconds turnaround{0};  ///< the device's own time, gaps and rests
};

/// One group of one device.
struct GroupLoad {
  std::string device;
  std::string group;
  std::chrono::milliseconds interval{0};  ///< 0: as fast as the bus allows
  std::vector<ExchangeReport> exchanges;
  std::optional<std::chrono::nanoseconds> line_time;  ///< of a cycle; nullopt: speed unknown
  LineTimeUse use;                                    ///< all 0 if the speed is unknown
  /// Shortest interval that the bus can carry if all groups of the link keep their proportions.
  /// nullopt: the group has no interval, or the speed is unknown.
  std::optional<std::chrono::milliseconds> shortest_interval;
};

/// Effect of another block size on one device.
struct BlockTrade {
  std::string device;
  std::uint32_t block_bytes = 0;                          ///< maximum bytes in one read
  bool configured = false;                                ///< the current size in the config
  std::chrono::nanoseconds cycle{0};                      ///< one cycle of each of its groups
  std::optional<std::chrono::nanoseconds> command_bound;  ///< of the link
};

struct LinkReport {
  std::string name;
  std::optional<int> baud;  ///< nullopt: unknown
  /// Time that the bus listens before the first request of each session, as in LinkConfig.
  std::chrono::milliseconds listening{0};
  /// Load that the poll intervals ask for; other groups use the rest. nullopt: speed unknown.
  std::optional<double> busy_percent;
  /// `bound_ms` of a one-word write with read-back while polls run and no command is queued. It is
  /// the longest such write that the config allows, else of any word among the tags, else of a
  /// force. nullopt: speed unknown, or nothing on the link is writable.
  std::optional<std::chrono::nanoseconds> command_bound;
  std::vector<GroupLoad> groups;
  std::vector<BlockTrade> block_trade;  ///< by device, ascending; empty without a speed
  std::vector<std::string> warnings;
};

/// Returns one report for each link. A device with model auto counts as the widest model.
std::vector<LinkReport> plan_links(const Config& config);

/// Returns "line1: press1/fast asks for 250 ms; …" for each link that is asked for more than it can
/// carry: each group and the interval that would fit if all groups kept their proportions. Same as
/// the warnings of plan_links(), but faster.
std::vector<std::string> overloads(const Config& config);

/// Adds the tags of "DEVICE FIRST..LAST@MS" (or "DEVICE ADDRESS@MS") to the device's first group
/// with that interval, or to a new group named what-if. The error is bad_request and names the
/// fault; for an address it quotes the codec.
Result<void> add_what_if(Config& config, const std::string& what);

}  // namespace fxagent
