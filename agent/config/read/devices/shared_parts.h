// Parts that many devices of a config have in common. A large plant has few different ones.
#pragma once

#include <cstddef>
#include <map>
#include <memory>
#include <set>
#include <unordered_map>
#include <utility>
#include <vector>

#include "agent/config/model.h"

namespace fxagent {

/// Makes each codec, TagUnits and list of tags once, for all devices with an equal one. Lives while
/// a config is read.
class SharedParts final {
 public:
  struct Protocol {
    std::shared_ptr<const Codec> codec;
    std::shared_ptr<const Options> options;
  };

  /// Returns the codec of these options. Error: as ProtocolInfo::make.
  Result<Protocol> protocol_of(const ProtocolInfo& info, Options options);
  /// Returns the codec for each of ProtocolInfo::models. `open` is one whose model is unknown.
  const std::vector<std::shared_ptr<const Codec>>& models_of(const ProtocolInfo& info,
                                                             const Codec& open);
  std::shared_ptr<const TagUnits> units_of(TagUnits units);
  SharedVector<TagConfig> tags_of(SharedVector<TagConfig> tags);

 private:
  struct ByValue {
    bool operator()(const auto& one, const auto& other) const { return *one < *other; }
  };

  std::map<std::pair<const ProtocolInfo*, Options>, Protocol> protocols_;
  std::map<const Codec*, std::vector<std::shared_ptr<const Codec>>> models_;
  std::set<std::shared_ptr<const TagUnits>, ByValue> units_;
  std::unordered_multimap<std::size_t, SharedVector<TagConfig>> tags_;
};

}  // namespace fxagent
