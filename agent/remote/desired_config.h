// A document of {base}/config/desired: what it says, and the config that it makes of the local
// file. A hostile sender is expected: sizes, depth and duplicates are checked before anything is
// done with it, and the local file's limits after. Pure, any thread.
#pragma once

#include <atomic>
#include <cstddef>
#include <functional>
#include <string>
#include <string_view>
#include <tl/expected.hpp>
#include <vector>

#include "agent/config/config.h"

namespace fxagent {

using ConfigErrors = std::vector<ConfigError>;

inline constexpr std::size_t kMaxDesiredVersion = 64;  ///< bytes; the same for `by`
/// Of JSON in a document. One of the most bytes has half as many where it lists tags.
inline constexpr std::size_t kMaxDesiredValues = 200'000;

struct DesiredConfig {
  std::string text;     ///< as it came
  std::string hash;     ///< of the text: the first 16 digits of its SHA-256
  std::string version;  ///< empty: it could not be read
  std::string by;       ///< who it says has sent it; nobody checks that. Empty: nobody
};

/// `desired` as far as it could be read, and all that is wrong with its shape.
struct ReadDesired {
  DesiredConfig desired;
  ConfigErrors errors;
};
/// Pointers below `config` and `patch` are those of the config: "/devices/0/name". Lines are 0.
ReadDesired read_desired(std::string_view payload);

/// The local file's text with the document put onto it: the sections of `config` take the place of
/// the local ones, a `patch` is merged into the whole as RFC 7396 says. Where something may not
/// be set remotely it is an error, and the local value stays.
struct MergedConfig {
  std::string text;
  ConfigErrors errors;
};
/// `local_text` is a right config. `desired` has no errors.
MergedConfig merged_config(std::string_view local_text, const DesiredConfig& desired,
                           const RemoteLimits& limits);

/// Reads a text as load_config() reads the local file, within kRemoteLimits.
using ParseConfig = std::function<tl::expected<Config, ConfigErrors>(std::string_view text)>;

/// The local file with the document, or every error. `local` is what `local_text` says. `stop`, set
/// by any thread, ends it early: then what it returns means nothing. Null: nobody does.
tl::expected<Config, ConfigErrors> effective_config(std::string_view local_text,
                                                    const Config& local,
                                                    const DesiredConfig& desired,
                                                    const ParseConfig& parse,
                                                    const std::atomic<bool>* stop = nullptr);

}  // namespace fxagent
