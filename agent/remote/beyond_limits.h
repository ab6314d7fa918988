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
/// A device is that of the local file where its name, its protocol with all options, and the port
/// or host of its link are the same: then it may do what it may there. Any other is a new one, and
/// commands may do nothing to it beyond `remote_allow`, whose ranges mean what they mean in the
/// local file (named_ranges.h). `stop`: set by any thread, it ends the search; null: nobody does.
std::vector<ConfigError> beyond_limits(const Config& local, const Config& wanted,
                                       const std::atomic<bool>* stop = nullptr);

}  // namespace fxagent
