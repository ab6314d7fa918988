#include "agent/remote/local_config.h"

#include "agent/config/loader.h"
#include "agent/config/read/config_limits.h"

namespace fxagent {

ConfigErrors not_built(const std::exception& fault) {
  return {{"", 0, std::string("cannot be applied: ") + fault.what()}};
}

tl::expected<LocalConfig::Read, ConfigErrors> LocalConfig::read() const {
  auto text = read_config_file(path_);
  if (!text) return tl::unexpected(std::move(text.error()));
  LocalFile file{std::move(*text), privacy_of(path_)};
  auto config = build(file, nullptr);
  if (!config) return tl::unexpected(std::move(config.error()));
  file.limits = config->remote;
  return Read{std::move(file), std::move(*config)};
}

tl::expected<Config, ConfigErrors> LocalConfig::build(const LocalFile& file,
                                                      const DesiredConfig* document) const {
  try {
    auto config = config_of_file(path_, file.text, file.privacy, {.stop = &interrupted_});
    if (!config || document == nullptr) return config;
    const ConfigLimits limits = remote_limits(*config);
    const auto parse = [&](std::string_view text) {
      return config_of_file(path_, text, file.privacy, {limits, &interrupted_});
    };
    return effective_config(file.text, *config, *document, parse, &interrupted_);
  } catch (const std::exception& fault) {  // such as out of memory
    return tl::unexpected(not_built(fault));
  }
}

}  // namespace fxagent
