// What a remote config may not do although its sections may come: let commands touch more than
// the local file does, send the password elsewhere, open whatever the machine has. Pure.
#pragma once

#include <atomic>
#include <vector>

#include "agent/config/config.h"

namespace fxagent {

/// Each right of `wanted` that `local` and its `remote_allow` do not give. Pointers are those of
/// the config as far as there are any; devices are named in the text. Both are right configs
/// without vacant places.
///
/// A device is the same as in the local file if its name, its protocol with all options, and the
/// port or host of its link are the same: it keeps its rights there, and every range of
/// `remote_allow` is added to them. Any other device is new: commands may do nothing to it except
/// in ranges whose entry names its protocol and model, and nothing at a port or host where the
/// local file has another protocol or model. Another thread may set `stop`, if it is not nullptr,
/// to end the search early.
std::vector<ConfigError> beyond_limits(const Config& local, const Config& wanted,
                                       const std::atomic<bool>* stop = nullptr);

}  // namespace fxagent
