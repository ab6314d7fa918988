// Reads a document of {base}/config/desired and merges it into the local file. The sender may be
// hostile: read_desired() checks size, depth and duplicates first, the merge then applies the
// limits of the local file (beyond_limits.cpp has those of rights). Pure, any thread.
#pragma once

#include <atomic>
#include <cstddef>
#include <functional>
#include <string>
#include <string_view>
#include <tl/expected.hpp>
#include <vector>

#include "agent/config/config_error.h"
#include "agent/config/model.h"

namespace fxagent {

inline constexpr std::size_t kMaxDesiredVersion = 64;  ///< bytes; the same for `by`
/// Most JSON values in a document. A document of kMaxDesiredBytes that lists tags has half as many.
inline constexpr std::size_t kMaxDesiredValues = 200'000;

struct DesiredConfig {
  std::string text;     ///< as received; empty if the document has errors
  std::string hash;     ///< of the document as received: the first 16 digits of its SHA-256
  std::string version;  ///< empty if it could not be read
  std::string by;       ///< sender according to the document, not verified; empty if not given
};

/// The document as far as it could be read, and all errors of its shape.
struct ReadDesired {
  DesiredConfig desired;
  ConfigErrors errors;
};
/// Reads a document. Error pointers below `config` and `patch` are those of the config, such as
/// "/devices/0/name"; lines are 0.
ReadDesired read_desired(std::string_view payload);

/// Returns an error for each right of `wanted` that `local` and its `remote_allow` do not give.
/// Errors of a device point at `/devices` and name it in the text. Both configs must be valid and
/// without vacant places.
///
/// A device of the local file (LocalDevices::find()) keeps its rights there, plus the ranges of
/// `remote_allow` without a protocol or with its protocol and model. Any other device is new:
/// commands may write to it only in ranges whose entry names its protocol and model, and nowhere if
/// LocalDevices::doubt() has one. `commands.allow_run_stop` in `remote_allow` applies to every
/// device. Any thread may set `stop` to end the search early; nullptr: it cannot be stopped.
std::vector<ConfigError> beyond_limits(const Config& local, const Config& wanted,
                                       const std::atomic<bool>* stop = nullptr);

/// Reads a merged text as load_config() reads the local file, within remote_limits().
using ParseConfig = std::function<tl::expected<Config, ConfigErrors>(std::string_view text)>;

/// Returns the local file merged with the document, or all errors: also one for each value that
/// must not be set remotely. The sections of `config` replace the local ones, except that `mqtt`
/// replaces only the keys it has; a `patch` is a JSON merge patch (RFC 7396) of the whole file.
/// `local` is the config of `local_text`, and `desired` has no errors. Any thread may set `stop` to
/// end the call early; its result is then meaningless. nullptr: the call cannot be stopped.
tl::expected<Config, ConfigErrors> effective_config(std::string_view local_text,
                                                    const Config& local,
                                                    const DesiredConfig& desired,
                                                    const ParseConfig& parse,
                                                    const std::atomic<bool>* stop = nullptr);

}  // namespace fxagent
