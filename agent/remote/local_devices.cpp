#include "agent/remote/local_devices.h"

#include <array>
#include <filesystem>
#include <variant>

#include "agent/config/read/host.h"
#include "protocol/catalog.h"
#include "protocol/plc.h"

namespace fxagent {
namespace {

using std::string_view_literals::operator""sv;

/// Options that lead a request through the PLC at the link to another one.
constexpr std::array kRoute{"network"sv, "pc"sv, "module_io"sv, "module_station"sv};

/// Returns the first of these options that is not the default; empty if there is none.
std::string_view route_of(const DeviceConfig& device) {
  for (const OptionSpec& spec : device.protocol->options)
    if (contains(kRoute, spec.key) && device.options->find(spec.key)->second != spec.fallback)
      return spec.key;
  return {};
}

/// True for the kernel's own name of a serial port, not for a link that a rule of udev makes.
bool is_kernel_name(std::string_view file) {
  for (const std::string_view kind : {"ttyS"sv, "ttyUSB"sv, "ttyACM"sv, "ttyAMA"sv})
    if (file.starts_with(kind) && file.size() > kind.size() &&
        file.find_first_not_of("0123456789", kind.size()) == file.npos)
      return true;
  return false;
}

}  // namespace

bool same_place(const LinkConfig& one, const LinkConfig& other) {
  return one.channel.index() == other.channel.index() && endpoint_of(one) == endpoint_of(other);
}

MachinePlace::MachinePlace(const LinkConfig& link) {
  const auto set = [this](const auto& channel) {
    if constexpr (requires { channel.path; }) {
      const auto path = std::filesystem::path(channel.path).lexically_normal();
      is_serial = true;
      const std::string directory = path.parent_path().string();
      const std::string file = path.filename().string();
      if (directory == "/dev/serial/by-id" || (directory == "/dev" && is_kernel_name(file))) {
        scope = directory;
        id = file;
      }
    } else {
      id = address_bytes(channel.host);
      scope = id.empty() ? "" : "address";
      port = channel.port;
    }
  };
  std::visit(set, link.channel);
}

bool MachinePlace::may_be(const MachinePlace& other) const {
  return is_serial == other.is_serial && (scope != other.scope || id == other.id);
}

LocalDevices::LocalDevices(const Config& local) : local_(local) {
  for (const DeviceConfig& device : local.devices) names_.emplace(device.name, &device);
  places_.reserve(local.links.size());
  for (const LinkConfig& link : local.links) places_.emplace_back(link);
}

LocalDevices::Known LocalDevices::find(const DeviceConfig& device, const LinkConfig& link) const {
  const auto found = names_.find(device.name);
  if (found == names_.end()) return {nullptr, "the local file has no device of this name"};
  const DeviceConfig& known = *found->second;
  DifferentKeys different;
  different.compare(known.protocol == device.protocol, "protocol");
  if (known.protocol == device.protocol)
    for (const auto& [key, value] : *device.options)
      different.compare(known.options->at(key) == value, key);
  different.compare(same_place(local_.links.at(known.link), link), "port or host");
  if (different.text().empty()) return {&known, {}};
  return {nullptr, "the local file's device of this name has a different " + different.text()};
}

std::string LocalDevices::doubt(const DeviceConfig& device, const LinkConfig& link) const {
  if (const auto key = route_of(device); !key.empty())
    return "\"" + std::string(key) + "\" is not the default, and may lead to another PLC";
  const MachinePlace place(link);
  const std::string model = model_of(*device.codec);
  for (const DeviceConfig& known : local_.devices) {
    const bool is_equal = known.protocol == device.protocol && model_of(*known.codec) == model;
    if (is_equal && route_of(known).empty()) continue;
    const MachinePlace& other = places_.at(known.link);
    // A serial device server has a line, and so another machine, at each TCP port.
    const bool on_lines = known.protocol->on_serial && device.protocol->on_serial;
    if (place.may_be(other) && !(on_lines && place.port != other.port))
      return "it may be the machine of " + known.name +
             ", whose protocol, model or route there is another or not known" +
             (!place.is_serial && (place.scope.empty() || other.scope.empty())
                  ? " (the agent resolves no host names)"
                  : "");
  }
  return {};
}

}  // namespace fxagent
