// Checks a stream of telemetry as an outside subscriber sees it: lost, repeated and out-of-order
// samples. Pure: messages in, report out; no network, no clock. Any thread, one at a time. Uses 8
// bytes of memory for each sample.
//
// `seq` rises by 1 for each sample of a device, across all its groups, live and history together.
// Every number above the first live one seen must arrive; lower numbers may have arrived before the
// check listened. A boot that began while it listened must arrive completely. After an interruption
// in which messages may have passed, an earlier gap proves nothing.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

namespace fxagent {

struct Config;

/// Inclusive range of sequence numbers.
struct NumberRange {
  std::uint64_t first = 0;
  std::uint64_t last = 0;
  bool operator==(const NumberRange&) const = default;
};

/// Ranges of sequence numbers. Lists only the first kMostListed.
struct NumberRanges {
  static constexpr std::size_t kMostListed = 10;
  std::uint64_t numbers = 0;  ///< total count in all ranges
  std::uint64_t ranges = 0;
  std::vector<NumberRange> listed;

  void add(NumberRange range);
};

/// Says if a new boot may skip numbers. It may after a crash with `sync: offline`, without a store,
/// and when a member of a pair takes over.
enum class BootSkip : std::uint8_t { allowed, is_loss };

/// Says if a new boot of the agent with this config may skip numbers.
BootSkip boot_skip(const Config& config);

struct DeviceStream {
  std::string device;
  bool expected = false;       ///< the caller named it as a device that must send
  std::uint64_t live = 0;      ///< samples, including repeats
  std::uint64_t history = 0;   ///< the same, in history messages
  std::uint64_t distinct = 0;  ///< distinct sequence numbers seen
  std::optional<NumberRange> seen;
  bool decided = false;  ///< a live sample was seen, so that a gap is meaningful
  NumberRanges missing;  ///< within the range that could be judged
  /// Not received, and may have been sent during an interruption; see StreamCheck::interrupted().
  NumberRanges unprovable;
  NumberRanges skipped;  ///< skipped by a new boot, as `sync: offline` allows after a crash
  std::uint64_t repeated = 0;
  std::uint64_t differing = 0;     ///< repeats that differ from the first sample of their number
  std::uint64_t disordered = 0;    ///< first seen after a higher number on the same topic
  std::uint64_t ts_backward = 0;   ///< on one topic a higher number with an earlier `ts`
  std::uint64_t malformed = 0;     ///< messages or rows that could not be parsed
  std::string malformed_why;       ///< fault of the first malformed one
  std::vector<std::string> boots;  ///< in the order first seen

  /// True if nothing is known to be missing, every number stands for one sample, and a device that
  /// must send has sent.
  bool is_sound() const {
    return (decided || !expected) && missing.numbers == 0 && differing == 0 && malformed == 0;
  }
  /// True if in addition nothing could have been missed.
  bool is_whole() const { return is_sound() && unprovable.numbers == 0; }
};

class StreamCheck final {
 public:
  /// `base` is "{root}/{id}". Each device in `expected` must send, or the stream is not whole.
  StreamCheck(std::string base, const std::vector<std::string>& expected, BootSkip skip);

  /// Processes a received message. Ignores topics other than the agent's data topics, and retained
  /// messages, which say nothing about the present.
  void take(std::string_view topic, std::string_view payload, bool retained);

  /// Records that messages may have been sent unheard since the last one. Numbers that have not
  /// arrived by now, and all those before the next live sample of their device, may be among them.
  /// They are unprovable unless a later message brings them.
  void interrupted();

  /// Returns the state of each device, sorted by name. A later sample may still fill a gap.
  std::vector<DeviceStream> report() const;

 private:
  /// Consecutive numbers of one boot, with a fingerprint of each sample.
  struct Run {
    std::uint32_t boot = 0;  ///< index in DeviceStream::boots
    std::vector<std::uint64_t> prints;
  };
  struct Boot {
    std::uint64_t lowest = 0;
    std::uint64_t highest = 0;
    std::optional<std::uint64_t> whole_from;  ///< every number from here on must arrive
  };
  struct Newest {
    std::uint64_t seq = 0;
    std::int64_t ts = 0;
  };
  struct Device {
    DeviceStream stream;
    std::map<std::uint64_t, Run> runs;  ///< by first number; they never overlap
    std::unordered_map<std::string, std::uint32_t> boot_index;
    std::vector<Boot> boots;
    std::map<std::string, Newest> topics;
    std::uint64_t proven_from = 0;  ///< gaps below it are unprovable
    bool awaits_live = false;       ///< no live sample since interrupted(): all gaps are
  };
  struct Sample;

  Device& device(std::string_view name);
  std::uint32_t boot_of(Device& device, const std::string& id, std::uint64_t seq) const;
  void take_sample(Device& device, std::string_view topic, const Sample& sample);
  void judge(const Device& device, DeviceStream& stream) const;

  const std::string base_;
  const BootSkip skip_;
  std::map<std::string, Device> devices_;
};

}  // namespace fxagent
