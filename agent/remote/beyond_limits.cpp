// Detects rights that a remote config must not take, even in sections that it may set: commands
// that touch more than the local file allows, the password sent to another server, device files of
// the machine other than serial ports.
#include <algorithm>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "agent/config/config_error.h"
#include "agent/config/json/tree.h"
#include "agent/config/read/findings.h"
#include "agent/remote/desired_config.h"
#include "agent/remote/local_devices.h"
#include "protocol/catalog.h"
#include "protocol/plc.h"
#include "protocol/value/point.h"

namespace fxagent {
namespace {

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

/// Reports links that a command may free for another program only in `wanted`.
void check_yields(const Config& local, const Config& wanted, ErrorList& errors) {
  for (std::size_t i = 0; i < wanted.links.size(); ++i) {
    const LinkConfig& link = wanted.links[i];
    if (!link.allow_yield) continue;
    const bool is_local = std::ranges::any_of(local.links, [&](const LinkConfig& known) {
      return known.allow_yield && known.name == link.name && same_place(known, link);
    });
    if (!is_local)
      errors.add({"/links/" + std::to_string(i) + "/allow_yield", 0,
                  "is set, but the local file does not allow it for this link at this port or "
                  "host"});
  }
}

/// Checks what commands may do to one device of `wanted`.
class DeviceLimits {
 public:
  /// `remote`: the limits of the local file, which has `devices`. `link`: that of `device`. All
  /// must outlive the object.
  DeviceLimits(const RemoteLimits& remote, const LocalDevices& devices, const DeviceConfig& device,
               const LinkConfig& link, ErrorList& errors)
      : remote_(remote),
        local_(devices.find(device, link)),
        known_(local_.device),
        device_(device),
        codec_(widest_of(*device.protocol, device.codec)),
        errors_(errors) {
    if (known_ != nullptr) allow_ = known_->commands.allow;
    // Every unit of the bus would obey a broadcast, those of the local file too.
    if (codec_->is_broadcast()) return;
    for (const RemoteRange& entry : remote_.allow) {
      if (entry.protocol == nullptr) {
        const auto span = codec_->addresses().parse_range(entry.range);
        if (span) (known_ != nullptr ? allow_ : local_only_).push_back(*span);
      } else if (entry.protocol == device.protocol && entry.model == model_of(*device.codec)) {
        if (known_ == nullptr && !doubt_) doubt_ = devices.doubt(device, link);
        (doubt_.value_or("").empty() ? allow_ : doubtful_).push_back(entry.span);
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

  /// Returns the reason why `span` is not open, and its cure, as far as they are certain.
  std::string why_not(const Span& span) const {
    if (known_ != nullptr || !allow_.empty()) return {};
    if (is_covered(span, doubtful_)) return ": " + *doubt_;
    if (!is_covered(span, local_only_)) return ": " + local_.why_new;
    const std::string model = model_of(*device_.codec);
    return ": " + local_.why_new +
           ", so remote_allow needs an entry with its protocol and model, such as "
           "\"commands.allow: " +
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
    if (const auto span = span_of(tag.point); span && is_covered(*span, doubtful_))
      return error(may_not + ": " + *doubt_);
    if (known_ == nullptr) return error(may_not + ": " + local_.why_new);
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
    DifferentKeys keys;
    keys.compare(a.address == b.address, "address");
    keys.compare(a.type == b.type, "type");
    keys.compare(a.order == b.order, "word_order");
    keys.compare(a.count == b.count && a.is_array == b.is_array, "count");
    keys.compare(a.length == b.length, "length");
    keys.compare(a.scale == b.scale, "scale");
    keys.compare(a.offset == b.offset, "offset");
    keys.compare(one.units->limits.min == other.units->limits.min, "min");
    keys.compare(one.units->limits.max == other.units->limits.max, "max");
    if (keys.text().empty()) keys.compare(a == b, "form");
    return keys.text();
  }

  const RemoteLimits& remote_;
  const LocalDevices::Known local_;
  const DeviceConfig* const known_;  ///< the device in the local file; nullptr: it is new
  const DeviceConfig& device_;
  const std::shared_ptr<const Codec> codec_;
  std::vector<Span> allow_;
  std::vector<Span> local_only_;      ///< ranges of remote_allow that a new device does not get
  std::optional<std::string> doubt_;  ///< of LocalDevices::doubt(); nullopt: not asked
  std::vector<Span> doubtful_;        ///< ranges that it does not get because of that
  ErrorList& errors_;
};

}  // namespace

std::vector<ConfigError> beyond_limits(const Config& local, const Config& wanted,
                                       const std::atomic<bool>* stop) {
  ErrorList errors;
  check_servers(local.mqtt, wanted.mqtt, errors);
  check_ports(local, wanted, errors);
  check_yields(local, wanted, errors);
  const LocalDevices devices(local);
  for (const DeviceConfig& device : wanted.devices) {
    if (stop != nullptr && *stop) break;
    DeviceLimits(local.remote, devices, device, wanted.links.at(device.link), errors).check();
  }
  return errors.take();
}

}  // namespace fxagent
