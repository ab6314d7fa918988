// How large a config may be. A few KiB of text can stand for more devices, tags and values than a
// machine has memory for, so they are counted before they are built.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>
#include <string_view>

#include "agent/config/config.h"

namespace fxagent {

/// What a text expands to.
struct ConfigSize {
  std::uint64_t links = 0;
  std::uint64_t devices = 0;
  std::uint64_t groups = 0;
  std::uint64_t tags = 0;
  /// That one read of everything brings: an array has `count` of them, a string one for two
  /// characters.
  std::uint64_t values = 0;

  /// Bytes that the agent needs for them while it polls all of them, as measured.
  std::uint64_t memory() const;
};
/// So many times what `size` has beyond `before`.
ConfigSize times(std::uint64_t count, const ConfigSize& size, const ConfigSize& before);
std::uint64_t values_of(const Point& point);
ConfigSize size_of(const Config& config);

struct ConfigLimits {
  std::string_view whose;  ///< "a config file"
  ConfigSize most;
  std::uint64_t memory = 0;   ///< bytes
  std::uint64_t written = 0;  ///< bytes of the devices of templates as if they were written out
};

/// Beyond these a file is a mistake. What it needs of memory is a matter of the machine.
inline constexpr ConfigLimits kFileLimits{
    "a config file", {100'000, 100'000, 200'000, 1'000'000, 10'000'000}, UINT64_MAX, 64u << 20};
/// So that what comes over MQTT fits into the 256 MiB of the service, whatever it says.
inline constexpr ConfigLimits kRemoteLimits{
    "a remote config", {10'000, 10'000, 20'000, 100'000, 500'000}, 128u << 20, 16u << 20};

/// kRemoteLimits, raised to what the local file has itself: a document may leave that as it is.
ConfigLimits remote_limits(const Config& local);

/// A config that needs more is worth a warning: the service may have 256 MiB in all.
inline constexpr std::uint64_t kMuchMemory = 192u << 20;

/// How far a text is read.
struct ReadBounds {
  const ConfigLimits& limits = kFileLimits;
  /// Set by any thread, it ends the reading: the error is then of no interest. Null: nobody does.
  const std::atomic<bool>* stop = nullptr;

  bool is_stopped() const { return stop != nullptr && *stop; }
};

/// Counts a config and says where it becomes too large.
class ConfigRoom final {
 public:
  explicit ConfigRoom(const ConfigLimits& limits) : limits_(limits) {}

  /// Empty: there is room for `more`. Else which limit it is beyond; from then on nothing fits.
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

/// parse_config() and config_of_file() within bounds.
tl::expected<Config, std::vector<ConfigError>> parse_config(std::string_view text,
                                                            const Environment& environment,
                                                            FilePrivacy privacy,
                                                            const ReadBounds& bounds);
/// `privacy`: that of the file when the text was read. Looks at no file.
tl::expected<Config, std::vector<ConfigError>> config_of_file(const std::string& path,
                                                              std::string_view text,
                                                              FilePrivacy privacy,
                                                              const ReadBounds& bounds = {});

}  // namespace fxagent
