// Detects rights that a remote config must not take, even in sections that it may set: commands
// that touch more than the local file allows, the password sent to another server, device files of
// the machine other than serial ports. Pure.
#pragma once

#include <atomic>
#include <vector>

#include "agent/config/config_error.h"
#include "agent/config/model.h"

namespace fxagent {

/// Returns an error for each right of `wanted` that `local` and its `remote_allow` do not give.
/// Errors of a device point at `/devices` and name it in the text. Both configs must be valid and
/// without vacant places.
///
/// A device is the same as in the local file if its name, its protocol with all options, and the
/// port or host of its link are the same. It keeps its rights there, plus the ranges of
/// `remote_allow` without a protocol or with its protocol and model. Any other device is new:
/// commands may do nothing to it except in ranges whose entry names its protocol and model, and
/// nothing at a port or host where the local file has another protocol or model. Any thread may set
/// `stop` to end the search early; nullptr: it cannot be stopped.
std::vector<ConfigError> beyond_limits(const Config& local, const Config& wanted,
                                       const std::atomic<bool>* stop = nullptr);

}  // namespace fxagent
