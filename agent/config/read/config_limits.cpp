#include "agent/config/read/config_limits.h"

#include <algorithm>
#include <array>

namespace fxagent {
namespace {

// Memory per object, measured with a PLC that answers. Devices that share codec or tags need less.
constexpr std::uint64_t kBytesOfLink = 4096;
constexpr std::uint64_t kBytesOfDevice = 6144;
constexpr std::uint64_t kBytesOfGroup = 512;
constexpr std::uint64_t kBytesOfTag = 256;
constexpr std::uint64_t kBytesOfValue = 192;

struct Count {
  std::uint64_t ConfigSize::*member;
  std::string_view name;
};
constexpr std::array kCounts{Count{&ConfigSize::links, "links"},
                             Count{&ConfigSize::devices, "devices"},
                             Count{&ConfigSize::groups, "groups"}, Count{&ConfigSize::tags, "tags"},
                             Count{&ConfigSize::values, "tag values"}};

std::string mebibytes(std::uint64_t bytes) { return std::to_string(bytes >> 20) + " MiB"; }

}  // namespace

std::uint64_t ConfigSize::memory() const {
  return kBytesOfLink * links + kBytesOfDevice * devices + kBytesOfGroup * groups +
         kBytesOfTag * tags + kBytesOfValue * values;
}

ConfigSize times(std::uint64_t count, const ConfigSize& size, const ConfigSize& before) {
  ConfigSize all;
  for (const auto& [member, name] : kCounts) all.*member = count * (size.*member - before.*member);
  return all;
}

std::uint64_t values_of(const Point& point) {
  return std::max<std::uint64_t>(point.count, point.length / 2u);
}

ConfigSize size_of(const Config& config) {
  ConfigSize size{.links = config.links.size(), .devices = config.devices.size()};
  for (const DeviceConfig& device : config.devices) {
    size.groups += device.groups.size();
    size.tags += device.tags.size();
    for (const TagConfig& tag : device.tags) size.values += values_of(tag.point);
  }
  return size;
}

ConfigLimits remote_limits(const Config& local) {
  ConfigLimits limits = kRemoteLimits;
  const ConfigSize own = size_of(local);
  for (const auto& [member, name] : kCounts) {
    if (own.*member <= limits.most.*member) continue;
    limits.most.*member = own.*member;
    limits.written = kFileLimits.written;
  }
  limits.memory = std::max(limits.memory, own.memory());
  return limits;
}

std::string ConfigRoom::add(const ConfigSize& more) {
  for (const auto& [member, name] : kCounts) {
    size_.*member += more.*member;
    const std::uint64_t most = limits_.most.*member;
    if (size_.*member <= most) continue;
    is_full_ = true;
    return "with this there are " + std::to_string(size_.*member) + " " + std::string(name) + "; " +
           std::string(limits_.whose) + " may have at most " + std::to_string(most);
  }
  if (size_.memory() <= limits_.memory) return {};
  is_full_ = true;
  return "with this the agent needs about " + mebibytes(size_.memory()) + " of memory; " +
         std::string(limits_.whose) + " may need at most " + mebibytes(limits_.memory);
}

}  // namespace fxagent
