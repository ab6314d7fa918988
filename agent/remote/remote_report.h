// What is answered on {base}/config/reported. Pure, any thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "agent/remote/desired_config.h"

namespace fxagent {

struct RemoteReport {
  enum class State : std::uint8_t { applied, rejected, rolled_back };
  State state = State::applied;
  DesiredConfig desired{};  ///< without its text; no hash: the local file alone is meant
  ConfigErrors errors{};    ///< as many as are reported
  std::size_t errors_in_all = 0;
  std::int64_t since_ms = 0;

  /// Whether both say the same; since when is not compared.
  bool says(const RemoteReport& other) const;
};
std::string_view to_string(RemoteReport::State state);
/// "/devices/0/name: must be …"
std::string text_of(const ConfigError& error);

/// So many errors are reported, so many bytes of each, and so many of all of them as they are
/// written in JSON.
inline constexpr std::size_t kMostReportedErrors = 1000;
inline constexpr std::size_t kMostErrorBytes = 1024;
inline constexpr std::size_t kMostReportedBytes = 48 * 1024;

/// Keeps of `errors` what is reported; one at least where there is one.
RemoteReport make_report(RemoteReport::State state, DesiredConfig desired,
                         const ConfigErrors& errors, std::int64_t since_ms);

/// The text for {base}/config/reported. `hash`: of the config in force; `in_force`: the remote
/// version in it, empty where there is none.
std::string reported_text(const RemoteReport& report, const std::string& hash,
                          const std::string& in_force, bool is_confirmed);

}  // namespace fxagent
