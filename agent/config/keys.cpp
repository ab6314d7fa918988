#include "agent/config/keys.h"

#include <map>

#include "agent/config/suggestions.h"
#include "protocol/value/word_order.h"

namespace fxagent {

const OptionSpec* option_named(const ProtocolInfo& protocol, std::string_view key) {
  const auto found = std::ranges::find(protocol.options, key, &OptionSpec::key);
  return found == protocol.options.end() ? nullptr : &*found;
}

ConfigKey option_key(const OptionSpec& option) {
  using Type = ConfigKey::Type;
  constexpr std::array kTypes{Type::integer, Type::boolean, Type::choice};  // by OptionSpec::Kind
  ConfigKey key{.section = "devices[]", .name = option.key, .meaning = option.meaning};
  key.type = kTypes[static_cast<std::size_t>(option.kind)];
  key.limits = {option.min, option.max};
  key.limits.words = option.choices;
  std::visit([&](const auto& value) { key.fallback = value; }, option.fallback);
  return key;
}

ConfigKey model_key(const ProtocolInfo& protocol) {
  static const auto words = [] {
    std::map<std::string_view, std::vector<std::string_view>> list;
    for (const ProtocolInfo& info : catalog()) {
      std::vector<std::string_view>& names = list[info.name];
      names.push_back(kAutoModel);
      names.insert(names.end(), info.models.begin(), info.models.end());
      names.insert(names.end(), info.kin.begin(), info.kin.end());
    }
    return list;
  }();
  ConfigKey key = config_key("devices[].model");
  key.type = ConfigKey::Type::choice;
  key.limits = std::span(words.at(protocol.name));
  key.meaning = protocol.model_meaning;
  return key;
}

std::vector<ConfigKey> protocol_keys(const ProtocolInfo& protocol) {
  std::vector<ConfigKey> keys{model_key(protocol)};
  for (const OptionSpec& option : protocol.options) keys.push_back(option_key(option));
  return keys;
}

ConfigKey protocol_key() {
  static const auto names = names_in(catalog());
  ConfigKey key = config_key("devices[].protocol");
  key.type = ConfigKey::Type::choice;
  key.limits = std::span(names);
  return key;
}

std::span<const ByteOrder> word_orders(const ProtocolInfo& protocol) {
  const std::span<const ByteOrder> all(kByteOrders);
  return option_named(protocol, "byte_order") == nullptr ? all.first(2) : all;
}

ConfigKey word_order_key(const ProtocolInfo* protocol) {
  ConfigKey key = config_key("devices[].tags[].word_order");
  constexpr std::size_t kNames = 2;  // low_first and high_first, before the orders
  static_assert(config_keys::kWordOrders.size() == kNames + kByteOrders.size());
  if (protocol != nullptr)
    key.limits = key.limits.words.first(kNames + word_orders(*protocol).size());
  return key;
}

}  // namespace fxagent
