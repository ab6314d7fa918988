// Judges a stream of telemetry as an outsider sees it on the topics: what is missing, what came
// twice, what came in disorder. Pure: messages in, report out; no network, no clock. Any thread,
// one at a time. Remembers 8 bytes for each sample.
//
// What it knows: `seq` rises by 1 for each sample of a device, over all its groups, live and
// history together. Every number behind the first live one that it saw must come; what is older may
// have come before it listened. A boot that began while it listened must come whole.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

namespace fxagent {

/// Numbers from `first` to `last`, both included.
struct NumberRange {
  std::uint64_t first = 0;
  std::uint64_t last = 0;
  bool operator==(const NumberRange&) const = default;
};

/// Ranges of numbers; of many only the first few are listed.
struct NumberRanges {
  static constexpr std::size_t kMostListed = 10;
  std::uint64_t numbers = 0;  ///< in all ranges together
  std::uint64_t ranges = 0;
  std::vector<NumberRange> listed;

  void add(NumberRange range);
};

/// Whether a new boot may leave numbers out: it may after a crash with `sync: offline`, or without
/// a store.
enum class BootSkip : std::uint8_t { allowed, is_loss };

struct DeviceStream {
  std::string device;
  bool expected = false;       ///< it was named to the check as one that must send
  std::uint64_t live = 0;      ///< samples, repeats included
  std::uint64_t history = 0;   ///< the same, in history messages
  std::uint64_t distinct = 0;  ///< numbers seen
  std::optional<NumberRange> seen;
  bool decided = false;  ///< a live sample was seen, so that a gap means something
  NumberRanges missing;  ///< of what could be judged
  NumberRanges skipped;  ///< left out by a new boot, as `sync: offline` may after a crash
  std::uint64_t repeated = 0;
  std::uint64_t differing = 0;     ///< of these: the number had another sample before
  std::uint64_t disordered = 0;    ///< first seen after a higher number on the same topic
  std::uint64_t ts_backward = 0;   ///< on one topic a higher number with an earlier `ts`
  std::uint64_t malformed = 0;     ///< messages or rows that could not be read
  std::string malformed_why;       ///< of the first of them
  std::vector<std::string> boots;  ///< in the order in which they were first seen

  /// Nothing is missing, every number stands for one sample, and who must send has sent.
  bool is_whole() const {
    return (decided || !expected) && missing.numbers == 0 && differing == 0 && malformed == 0;
  }
};

class StreamCheck final {
 public:
  /// `base` is "{root}/{id}". `expected` must send, or the stream is not whole.
  StreamCheck(std::string base, const std::vector<std::string>& expected, BootSkip skip);

  /// A message as it came. What is on no data topic of the agent is ignored, and so is what is
  /// retained: it tells nothing of now.
  void take(std::string_view topic, std::string_view payload, bool retained);

  /// Each device, by name, as of now: a gap may still be filled by what comes later.
  std::vector<DeviceStream> report() const;

 private:
  /// Neighbouring numbers of one boot, with a fingerprint of each sample.
  struct Run {
    std::uint32_t boot = 0;  ///< index in DeviceStream::boots
    std::vector<std::uint64_t> prints;
  };
  struct Boot {
    std::uint64_t lowest = 0;
    std::uint64_t highest = 0;
    std::optional<std::uint64_t> whole_from;  ///< from this number on all must come
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
    std::map<std::string, Newest, std::less<>> topics;
  };
  struct Sample;

  Device& device(std::string_view name);
  std::uint32_t boot_of(Device& device, const std::string& id, std::uint64_t seq) const;
  void take_sample(Device& device, std::string_view topic, const Sample& sample);
  void judge(const Device& device, DeviceStream& stream) const;

  const std::string base_;
  const BootSkip skip_;
  std::map<std::string, Device, std::less<>> devices_;
};

}  // namespace fxagent
