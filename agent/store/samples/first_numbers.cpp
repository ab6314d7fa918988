#include "agent/store/samples/first_numbers.h"

namespace fxagent {

std::vector<std::uint64_t> first_numbers(const Config& config, Store* store, std::int64_t utc_ms) {
  if (store == nullptr)
    return std::vector<std::uint64_t>(config.devices.size(), static_cast<std::uint64_t>(utc_ms));
  std::vector<std::string> names;
  for (const DeviceConfig& device : config.devices) names.push_back(device.name);
  return store->numbers().begin(names, utc_ms);
}

std::vector<std::uint64_t> later_numbers(const Config& config,
                                         const std::map<std::string, std::uint64_t>& found) {
  std::vector<std::uint64_t> numbers;
  for (const DeviceConfig& device : config.devices) {
    const auto number = found.find(device.name);
    numbers.push_back(number == found.end() ? 0 : number->second);
  }
  return numbers;
}

}  // namespace fxagent
