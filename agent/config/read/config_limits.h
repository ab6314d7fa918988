// Limits on the size of a config. A few KiB of text can stand for more devices, tags and values
// than fit into memory, so the reader counts them before it builds them.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>
#include <string_view>

#include "agent/config/model.h"

namespace fxagent {

/// Number of objects that a config expands to.
struct ConfigSize {
  std::uint64_t links = 0;
  std::uint64_t devices = 0;
  std::uint64_t groups = 0;
  std::uint64_t tags = 0;
  /// Values that one read of all tags returns: `count` for an array, one for every two characters
  /// of a string.
  std::uint64_t values = 0;

  /// Returns the bytes of memory that the agent needs while it polls all of them, as measured.
  std::uint64_t memory() const;
};
/// Returns `count` times the difference between `size` and `before`.
ConfigSize times(std::uint64_t count, const ConfigSize& size, const ConfigSize& before);
std::uint64_t values_of(const Point& point);
ConfigSize size_of(const Config& config);

struct ConfigLimits {
  std::string_view whose;  ///< for error texts: "a config file"
  ConfigSize most;
  std::uint64_t memory = 0;   ///< bytes, see ConfigSize::memory()
  std::uint64_t written = 0;  ///< bytes of the devices of templates, if written out in full
};

/// A larger file is a mistake. Memory is not limited: that depends on the machine.
inline constexpr ConfigLimits kFileLimits{
    "a config file", {100'000, 100'000, 200'000, 1'000'000, 10'000'000}, UINT64_MAX, 64u << 20};
/// Keeps every config that arrives over MQTT within the 256 MiB of the service.
inline constexpr ConfigLimits kRemoteLimits{
    "a remote config", {10'000, 10'000, 20'000, 100'000, 500'000}, 128u << 20, 16u << 20};

/// Returns kRemoteLimits, raised to the size of the local file, so that a document may leave it
/// unchanged.
ConfigLimits remote_limits(const Config& local);

/// A config that needs more memory gets a warning: the service has 256 MiB.
inline constexpr std::uint64_t kMuchMemory = 192u << 20;

/// Limits of reading a text.
struct ReadBounds {
  const ConfigLimits& limits = kFileLimits;
  /// Any thread may set it to end reading with an error, which the caller ignores. nullptr: reading
  /// cannot be stopped.
  const std::atomic<bool>* stop = nullptr;

  bool is_stopped() const { return stop != nullptr && *stop; }
};

/// Counts the objects of a config and detects when it becomes too large.
class ConfigRoom final {
 public:
  explicit ConfigRoom(const ConfigLimits& limits) : limits_(limits) {}

  /// Adds `more`. Returns an empty string if it is within the limits. Otherwise returns the limit
  /// exceeded as an error text; nothing fits afterwards.
  std::string add(const ConfigSize& more);
  bool fits(const ConfigSize& more) const { return ConfigRoom(*this).add(more).empty(); }
  bool is_full() const { return is_full_; }
  const ConfigSize& size() const { return size_; }
  const ConfigLimits& limits() const { return limits_; }

 private:
  const ConfigLimits& limits_;
  ConfigSize size_;
  bool is_full_ = false;
};

}  // namespace fxagent
