// What is kept on disk of remote configs, as text: the last one that proved good, the one on
// trial, and the one that was rolled back. Pure, any thread.
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

/// One that is being judged, before anything of it is in force: reading it may end the process too.
struct JudgedConfig {
  std::string text;  ///< of the document; empty where an earlier version of the agent has kept it
  std::string hash;  ///< of the document
  std::string version;
  std::string by;
};

/// Not tried again until another one comes.
struct RolledBackConfig {
  std::string hash;  ///< of the document
  std::string version;
  std::string by;
  std::string why;
  std::int64_t since_ms = 0;
};

struct KeptConfigs {
  std::string agent{};               ///< whose they are: its base topic
  std::optional<KeptConfig> good{};  ///< nothing: the local file alone
  /// The good one before it, should that end the process although it was good.
  std::optional<KeptConfig> before{};
  /// The good one is in force in a process that is in its first hour. Where it is found at a start,
  /// that process has ended in this hour, and was not told to.
  bool watched = false;
  int ends = 0;        ///< of processes in such an hour, one after the other
  std::string boot{};  ///< of the machine, when this was written
  /// In force, and not proved yet. Where it is found at a start, the process has ended meanwhile.
  std::optional<KeptConfig> trying{};
  /// The process was told to end while it was trying or judging: that proves nothing.
  bool stopped = false;
  std::optional<JudgedConfig> judged{};  ///< found at a start: judging it has ended the process
  std::optional<RolledBackConfig> rolled_back{};

  bool empty() const { return !good && !trying && !judged && !rolled_back; }
  /// The good one has ended the process too often: the one before it takes its place.
  void set_good_aside();
};

/// Room for four documents, each character of them escaped.
inline constexpr std::size_t kMaxKeptBytes = 32 * kMaxDesiredBytes;

std::string to_text(const KeptConfigs& kept);
/// The error says what is wrong: damaged text, or a document that is not the one that was kept.
tl::expected<KeptConfigs, std::string> kept_configs_from(std::string_view text);

}  // namespace fxagent
