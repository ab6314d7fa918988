#include "agent/config/read/devices/shared_parts.h"

#include <boost/container_hash/hash.hpp>
#include <string_view>

#include "protocol/plc.h"

namespace fxagent {
namespace {

/// Hashes the members that commonly differ between lists. Lists with equal hashes are compared.
std::size_t hash_of(const SharedVector<TagConfig>& tags) {
  std::size_t hash = tags.size();
  for (const TagConfig& tag : tags) {
    boost::hash_combine(hash, std::string_view(tag.name));
    boost::hash_combine(hash, std::string_view(tag.point.address.text));
    boost::hash_combine(hash, tag.point.scale);
    boost::hash_combine(hash, tag.point.offset);
    boost::hash_combine(hash, tag.units.get());  // of units_of()
  }
  return hash;
}

}  // namespace

Result<SharedParts::Protocol> SharedParts::protocol_of(const ProtocolInfo& info, Options options) {
  const std::pair kind(&info, std::move(options));
  if (const auto known = protocols_.find(kind); known != protocols_.end()) return known->second;
  auto codec = info.make(kind.second);
  if (!codec) return tl::unexpected(codec.error());
  return protocols_.emplace(kind, Protocol{*codec, std::make_shared<const Options>(kind.second)})
      .first->second;
}

const std::vector<std::shared_ptr<const Codec>>& SharedParts::models_of(const ProtocolInfo& info,
                                                                        const Codec& open) {
  auto& models = models_[&open];
  if (models.empty())
    for (const std::string_view model : info.models)
      models.push_back(open.plc()->with_model(model));
  return models;
}

std::shared_ptr<const TagUnits> SharedParts::units_of(TagUnits units) {
  if (units == TagUnits{}) return no_units();
  return *units_.insert(std::make_shared<const TagUnits>(std::move(units))).first;
}

SharedVector<TagConfig> SharedParts::tags_of(SharedVector<TagConfig> tags) {
  const std::size_t hash = hash_of(tags);
  const auto [first, last] = tags_.equal_range(hash);
  for (auto known = first; known != last; ++known)
    if (known->second == tags) return known->second;
  return tags_.emplace(hash, std::move(tags))->second;
}

}  // namespace fxagent
