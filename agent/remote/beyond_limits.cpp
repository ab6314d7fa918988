// Detects rights that a remote config must not take, even in sections that it may set: commands
// that touch more than the local file allows, the password sent to another server, device files of
// the machine other than serial ports.
#include <algorithm>
#include <memory>
#include <string>
#include <string_view>
#include <unordered_map>
#include <utility>
#include <variant>
#include <vector>

#include "agent/config/config_error.h"
#include "agent/config/json/tree.h"
#include "agent/config/read/findings.h"
#include "agent/remote/desired_config.h"
#include "protocol/catalog.h"
#include "protocol/plc.h"
#include "protocol/value/point.h"

namespace fxagent {
namespace {

/// Devices of the local file by name.
using LocalDevices = std::unordered_map<std::string_view, const DeviceConfig*>;

bool has_credentials(const MqttConfig& mqtt) {
  return !mqtt.username.empty() || !mqtt.password.empty() || !mqtt.password_file.empty() ||
         !mqtt.password_env.empty() || (mqtt.tls && !mqtt.tls->cert_file.empty());
}

/// Reports new servers if the agent would send them its credentials. New mqtts:// servers are
/// allowed if the local file has its own ca_file.
void check_servers(const MqttConfig& local, const MqttConfig& wanted, ErrorList& errors) {
  if (!has_credentials(local)) return;
  const bool own_authority = local.tls && !local.tls->ca_file.empty();
  for (std::size_t i = 0; i < wanted.servers.size(); ++i) {
    const std::string& server = wanted.servers[i];
    if (contains(local.servers, server)) continue;
    if (own_authority && server.starts_with("mqtts://")) continue;
    errors.add({"/mqtt/servers/" + std::to_string(i), 0,
                shown(server) +
                    " would receive the agent's password; a remote config may only add "
                    "mqtts:// servers, and only if the local file sets mqtt.tls.ca_file"});
  }
}

/// True for names of serial ports, false for a watchdog, a virtual console or a disk. Also true for
/// a serial port that is the machine's console.
bool is_serial_name(std::string_view path) {
  if (path.find("..") != path.npos) return false;
  if (path.starts_with("/dev/serial/by-id/") || path.starts_with("/dev/serial/by-path/"))
    return true;
  constexpr std::string_view tty = "/dev/tty";
  if (!path.starts_with(tty)) return false;
  path.remove_prefix(tty.size());
  const auto is_letter = [](char c) { return (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z'); };
  const auto is_digit = [](char c) { return c >= '0' && c <= '9'; };
  const auto number = std::ranges::find_if_not(path, is_letter);
  return number != path.begin() && number != path.end() &&
         std::all_of(number, path.end(), is_digit);
}

void check_ports(const Config& local, const Config& wanted, ErrorList& errors) {
  for (std::size_t i = 0; i < wanted.links.size(); ++i) {
    const auto* serial = std::get_if<SerialSettings>(&wanted.links[i].channel);
    if (serial == nullptr || is_serial_name(serial->path)) continue;
    const bool is_local = std::ranges::any_of(local.links, [&](const LinkConfig& link) {
      const auto* known = std::get_if<SerialSettings>(&link.channel);
      return known != nullptr && known->path == serial->path;
    });
    if (!is_local)
      errors.add({"/links/" + std::to_string(i) + "/serial/path", 0,
                  shown(serial->path) +
                      " is not the name of a serial port (/dev/serial/by-id/…, /dev/ttyUSB0); a "
                      "remote config may only set such names, and paths of the local file"});
  }
}

/// True if both use the same serial port, or the same host and port. Ignores local_port: the source
/// port of requests does not identify the device.
bool same_place(const LinkConfig& one, const LinkConfig& other) {
  return one.channel.index() == other.channel.index() && endpoint_of(one) == endpoint_of(other);
}

/// Returns the device of `local` that this device of `wanted` is; nullptr if it is new.
const DeviceConfig* local_device(const Config& local, const LocalDevices& devices,
                                 const Config& wanted, const DeviceConfig& device) {
  const auto found = devices.find(device.name);
  if (found == devices.end()) return nullptr;
  const DeviceConfig& known = *found->second;
  const bool same = known.protocol == device.protocol && *known.options == *device.options &&
                    same_place(local.links.at(known.link), wanted.links.at(device.link));
  return same ? &known : nullptr;
}

/// True if every device that the local file has at this port or host is of the same protocol and
/// model: a document must not declare another one in order to renumber the addresses of a machine.
bool fits_its_place(const Config& local, const LinkConfig& link, const DeviceConfig& device) {
  return std::ranges::all_of(local.devices, [&](const DeviceConfig& known) {
    return !same_place(local.links.at(known.link), link) ||
           (known.protocol == device.protocol && model_of(*known.codec) == model_of(*device.codec));
  });
}

/// Checks what commands may do to one device of `wanted`.
class DeviceLimits {
 public:
  /// `known`: this device in the local file; nullptr if it has none. `link`: its link in `wanted`.
  /// All must outlive the object.
  DeviceLimits(const Config& local, const DeviceConfig* known, const DeviceConfig& device,
               const LinkConfig& link, ErrorList& errors)
      : remote_(local.remote),
        known_(known),
        device_(device),
        codec_(widest_of(*device.protocol, device.codec)),
        errors_(errors) {
    if (known != nullptr) allow_ = known->commands.allow;
    // Every unit of the bus would obey a broadcast, those of the local file too.
    if (codec_->is_broadcast()) return;
    for (const RemoteRange& entry : remote_.allow) {
      if (entry.protocol == nullptr) {
        const auto span = codec_->addresses().parse_range(entry.range);
        if (span) (known != nullptr ? allow_ : local_only_).push_back(*span);
      } else if (entry.protocol == device.protocol && entry.model == model_of(*device.codec) &&
                 (known != nullptr || fits_its_place(local, link, device))) {
        allow_.push_back(entry.span);
      }
    }
  }

  void check() {
    for (const Span& span : device_.commands.allow)
      if (!is_covered(span, allow_))
        error("commands.allow with " + names_of(codec_->addresses(), span) +
              " goes beyond the local file and its remote_allow" + why_not(span));
    for (const TagConfig& tag : device_.tags)
      if (tag.writable && !is_open(tag)) check_tag(tag);
    const CommandRules& rules = device_.commands;
    const CommandRules limits = known_ != nullptr ? known_->commands : CommandRules{};
    if (rules.allow_run_stop && !limits.allow_run_stop && !remote_.run_stop)
      error("commands.allow_run_stop is set, but the local file does not allow it");
    if (rules.max_expiry > limits.max_expiry)
      error("commands.max_expiry_s is longer than the local file's " +
            std::to_string(limits.max_expiry.count()));
    if (!rules.verify && limits.verify) error("commands.verify is off, but on in the local file");
  }

 private:
  void error(std::string text) {
    errors_.add({"/devices", 0, device_.name + ": " + std::move(text)});
  }

  /// Names the cure if `span` is open to devices of the local file only.
  std::string why_not(const Span& span) const {
    if (!is_covered(span, local_only_)) return {};
    const std::string model = model_of(*device_.codec);
    return ": this device differs from that of the local file, or is not in it; remote_allow needs "
           "an entry with its protocol and model, such as \"commands.allow: " +
           std::string(device_.protocol->name) +
           (device_.protocol->models.empty() ? "" : ' ' + (model.empty() ? "MODEL" : model)) +
           " RANGE\"";
  }

  /// True if commands may write the tag's address directly.
  bool is_open(const TagConfig& tag) const {
    const auto span = span_of(tag.point);
    return span && is_covered(*span, allow_);
  }

  /// Checks a writable tag outside of the allowed ranges. It must be a writable tag of the same
  /// device in the local file, with the same name, address, type, scale and limits.
  void check_tag(const TagConfig& tag) {
    const std::string may_not =
        "the tag " + std::string(tag.name) +
        " may be written, but the local file does not let commands write there";
    if (known_ == nullptr)
      return error(may_not +
                   ": it has no device of this name with this protocol, these options and this "
                   "port or host");
    const auto same = std::ranges::find(known_->tags, tag.name, &TagConfig::name);
    if (same == known_->tags.end())
      return error(may_not + " under this name: it does not have this tag");
    if (!same->writable) return error(may_not + ": its access there is read");
    if (const std::string what = differences(*same, tag); !what.empty())
      error(may_not + " in this way: different " + what);
  }

  /// Returns the keys that differ, "min, scale"; empty if both tags allow the same writes.
  static std::string differences(const TagConfig& one, const TagConfig& other) {
    const Point& a = one.point;
    const Point& b = other.point;
    std::string text;
    const auto compare = [&text](bool same, std::string_view what) {
      if (!same) text += (text.empty() ? "" : ", ") + std::string(what);
    };
    compare(a.address == b.address, "address");
    compare(a.type == b.type, "type");
    compare(a.order == b.order, "word_order");
    compare(a.count == b.count && a.is_array == b.is_array, "count");
    compare(a.length == b.length, "length");
    compare(a.scale == b.scale, "scale");
    compare(a.offset == b.offset, "offset");
    compare(one.units->limits.min == other.units->limits.min, "min");
    compare(one.units->limits.max == other.units->limits.max, "max");
    if (text.empty() && a != b) text = "form";
    return text;
  }

  const RemoteLimits& remote_;
  const DeviceConfig* known_;
  const DeviceConfig& device_;
  const std::shared_ptr<const Codec> codec_;
  std::vector<Span> allow_;
  std::vector<Span> local_only_;  ///< ranges of remote_allow that a new device does not get
  ErrorList& errors_;
};

}  // namespace

std::vector<ConfigError> beyond_limits(const Config& local, const Config& wanted,
                                       const std::atomic<bool>* stop) {
  ErrorList errors;
  check_servers(local.mqtt, wanted.mqtt, errors);
  check_ports(local, wanted, errors);
  LocalDevices devices;
  for (const DeviceConfig& device : local.devices) devices.emplace(device.name, &device);
  for (const DeviceConfig& device : wanted.devices) {
    if (stop != nullptr && *stop) break;
    const DeviceConfig* known = local_device(local, devices, wanted, device);
    DeviceLimits(local, known, device, wanted.links.at(device.link), errors).check();
  }
  return errors.take();
}

}  // namespace fxagent
