// What `fxagent plan` knows of a config: the reads that will be sent, the line time that they take
// and where it goes, what the line can carry, and the bound of commands. Pure.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "agent/config/config.h"

namespace fxagent {

/// One exchange of a group's cycle.
struct ExchangeReport {
  /// Of the first device of each place that it reads: one, or those that go by one frame.
  std::vector<std::string> addresses;
  bool gathered = false;    ///< by a command for several places
  std::uint32_t bits = 0;   ///< of all places
  std::uint32_t chars = 0;  ///< on the line in both directions, an enquiry before it included
  /// Its characters, turnaround, gap and rest; nullopt: the line's speed is not known.
  std::optional<std::chrono::nanoseconds> line_time;

  std::uint32_t bytes() const { return (bits + 7) / 8; }
};

/// Where a cycle's line time goes. Together they are the whole of it.
struct LineTimeUse {
  std::chrono::nanoseconds asked{0};    ///< characters of what the tags ask for
  std::chrono::nanoseconds framing{0};  ///< characters that an exchange has whatever it reads
  std::chrono::nanoseconds unasked{0};  ///< characters of gaps and of what alignment adds
  /// Bits of bit devices that come along because the protocol reads them by the byte or word.
  std::chrono::nanoseconds word_access{0};
  std::chrono::nanoseconds turnaround{0};  ///< the device's own time, gaps and rests
};

/// One group of one device.
struct GroupLoad {
  std::string device;
  std::string group;
  std::chrono::milliseconds interval{0};  ///< 0: as fast as the line allows
  std::vector<ExchangeReport> exchanges;
  std::optional<std::chrono::nanoseconds> line_time;  ///< of a cycle; nullopt: speed not known
  LineTimeUse use;                                    ///< all 0 where the speed is not known
  /// The shortest interval that the line could carry, if all groups of the link kept their
  /// proportions; nullopt where the group has no interval, or no speed is known.
  std::optional<std::chrono::milliseconds> shortest_interval;
};

/// What another block size would mean for one device.
struct BlockTrade {
  std::string device;
  std::uint32_t block_bytes = 0;                          ///< the most that one read brings
  bool configured = false;                                ///< it is what the config has now
  std::chrono::nanoseconds cycle{0};                      ///< one cycle of each of its groups
  std::optional<std::chrono::nanoseconds> command_bound;  ///< of the link
};

struct LinkReport {
  std::string name;
  std::optional<int> baud;  ///< nullopt: not known
  /// How long the line listens before the first question of each session, as in LinkConfig.
  std::chrono::milliseconds listening{0};
  /// What the intervals ask of the line; groups without one take the rest. nullopt: speed not
  /// known.
  std::optional<double> busy_percent;
  /// `bound_ms` of a one-word write with its read-back, beside the polls and with nothing queued
  /// before it: the longest such write that the config allows, else of any word among the tags,
  /// else a force. nullopt: speed not known, or nothing here can be written.
  std::optional<std::chrono::nanoseconds> command_bound;
  std::vector<GroupLoad> groups;
  std::vector<BlockTrade> block_trade;  ///< by device, from small to large; empty without a speed
  std::vector<std::string> warnings;
};

/// One report for each link of the config. A device whose model is open counts as the widest.
std::vector<LinkReport> plan_links(const Config& config);

/// "line1: press1/fast asks for 250 ms; …": of each group whose link is asked for more than it
/// carries the interval that would fit, if all groups of the link kept their proportions. As in the
/// warnings of plan_links(), which takes longer.
std::vector<std::string> overloads(const Config& config);

/// Adds the tags of "DEVICE FIRST..LAST@MS" (or "DEVICE ADDRESS@MS") to the device's first group
/// of that interval, or to a new one named what-if. bad_request names what is wrong with it, an
/// address in the words of its codec.
Result<void> add_what_if(Config& config, const std::string& what);

}  // namespace fxagent
