// Feeds arbitrary messages on sample topics to the stream check. Each line of the input is a
// message; its first byte selects the topic. Nothing may crash, and the counts must be consistent.
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <string_view>

#include "agent/cli/report/stream_check.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace fxagent;
  std::string_view text(reinterpret_cast<const char*>(data), size);
  const bool skips = !text.empty() && text.front() % 2 == 0;
  StreamCheck check("b", {"p"}, skips ? BootSkip::allowed : BootSkip::is_loss);
  while (!text.empty()) {
    const std::string_view line = text.substr(0, text.find('\n'));
    text.remove_prefix(std::min(text.size(), line.size() + 1));
    if (line.empty()) continue;
    constexpr std::string_view topics[] = {"b/p/data/f", "b/p/data/f/history", "b/p/data/s",
                                           "b/q/data/f/history"};
    check.take(topics[static_cast<unsigned char>(line.front()) % 4], line.substr(1), false);
  }
  for (const DeviceStream& stream : check.report()) {
    const std::uint64_t samples = stream.live + stream.history;
    if (stream.distinct + stream.repeated != samples || stream.differing > stream.repeated ||
        stream.disordered > stream.distinct || stream.seen.has_value() != (stream.distinct > 0) ||
        stream.missing.listed.size() > NumberRanges::kMostListed)
      std::abort();
    if (!stream.seen) continue;
    // Modulo 2^64: the full range of numbers would be one more than the type can hold.
    const std::uint64_t span = stream.seen->last - stream.seen->first + 1;
    const std::uint64_t known = stream.distinct + stream.missing.numbers + stream.skipped.numbers;
    if (span != 0 && known > span) std::abort();
  }
  return 0;
}
