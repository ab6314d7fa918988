// The kept remote configs: the last good one, the one on trial, and the one that was rolled back.
// Their text format, and their fate after the end of a process. Pure, any thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <tl/expected.hpp>

#include "agent/remote/desired_config.h"

namespace fxagent {

struct KeptConfig {
  DesiredConfig document;
  std::int64_t since_ms = 0;  ///< in force since, ms UTC
};

/// A document that was rolled back. The agent does not try it again until a different one arrives.
struct RolledBackConfig {
  std::string hash;  ///< of the document
  std::string version;
  std::string by;
  std::string why;
  std::int64_t since_ms = 0;
};

struct KeptConfigs {
  std::string agent{};               ///< base topic of the agent that owns the file
  std::optional<KeptConfig> good{};  ///< nullopt: the local file alone
  /// The good config before `good`; replaces it if `good` ends the process too often.
  std::optional<KeptConfig> before{};
  /// `good` is in force, and the process is in its first hour with it. If a start finds this set,
  /// the last process ended within the hour without a stop.
  bool watched = false;
  int ends = 0;        ///< such ends in a row
  std::string boot{};  ///< boot id of the machine when the file was written
  /// Config in force and on trial. If a start finds it, the process ended during the trial.
  std::optional<KeptConfig> trying{};
  /// The process was stopped during a trial or while judging, so its end proves nothing.
  bool stopped = false;
  /// The document that is being judged, before any of it is in force: reading it may crash the
  /// process. If a start finds it, the process ended while judging it. Its text is empty if an
  /// earlier version of the agent wrote it.
  std::optional<DesiredConfig> judged{};
  std::optional<RolledBackConfig> rolled_back{};

  bool empty() const { return !good && !trying && !judged && !rolled_back; }
  /// True if `kept` is the good config. Compares the documents.
  bool is_good(const std::optional<KeptConfig>& kept) const;
};

/// Rolls back the config that is to blame for the end of the last process, if there is one: a good
/// config only after the second such end in a row. `boot` is the present boot id. Returns the
/// document to judge again; empty if there is none.
std::string judge_last_run(KeptConfigs& kept, const std::string& boot, std::int64_t now_ms);

/// Room for four documents with every character escaped.
inline constexpr std::size_t kMaxKeptBytes = 32 * kMaxDesiredBytes;

std::string to_text(const KeptConfigs& kept);
/// Parses the file. The error text names the fault: damaged, or a document of another hash.
tl::expected<KeptConfigs, std::string> kept_configs_from(std::string_view text);

}  // namespace fxagent
