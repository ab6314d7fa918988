// Answers on {base}/config/reported. Pure, any thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "agent/config/config_error.h"
#include "agent/remote/desired_config.h"

namespace fxagent {

struct RemoteReport {
  enum class State : std::uint8_t { applied, rejected, rolled_back };
  State state = State::applied;
  DesiredConfig desired{};  ///< without its text; an empty hash means the local file alone
  ConfigErrors errors{};    ///< those reported, at most kMostReportedErrors
  std::size_t errors_in_all = 0;
  std::int64_t since_ms = 0;

  /// True if both reports are equal, ignoring `since_ms`.
  bool says(const RemoteReport& other) const;
};
std::string_view to_string(RemoteReport::State state);
/// Returns "/devices/0/name: must be …".
std::string text_of(const ConfigError& error);

/// Limits of a report: number of errors, bytes of each, and bytes of all errors as JSON text.
inline constexpr std::size_t kMostReportedErrors = 1000;
inline constexpr std::size_t kMostErrorBytes = 1024;
inline constexpr std::size_t kMostReportedBytes = 48 * 1024;

/// Returns a report with the errors within these limits; at least the first one.
RemoteReport make_report(RemoteReport::State state, DesiredConfig desired,
                         const ConfigErrors& errors, std::int64_t since_ms);

/// Returns the payload for {base}/config/reported. `hash` is that of the config in force.
/// `in_force` is the version of the remote config in it, empty if there is none.
std::string reported_text(const RemoteReport& report, const std::string& hash,
                          const std::string& in_force, bool is_confirmed);

}  // namespace fxagent
