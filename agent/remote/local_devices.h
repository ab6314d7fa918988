// The devices of the local file, by name and by place, to tell whether a device of a remote config
// is one of them. Compares texts only: asks no resolver and follows no link on disk. Pure, any
// thread.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "agent/config/model.h"

namespace fxagent {

/// Lists the keys that differ, "min, scale".
class DifferentKeys final {
 public:
  /// Adds `key` unless it is the same.
  void compare(bool is_same, std::string_view key) {
    if (!is_same) text_ += (text_.empty() ? "" : ", ") + std::string(key);
  }
  /// Returns the list; empty if nothing differs.
  const std::string& text() const { return text_; }

 private:
  std::string text_;
};

/// True if both use the same serial port, or the same host and port over the same transport.
/// Ignores local_port: the source port of requests does not identify the device.
bool same_place(const LinkConfig& one, const LinkConfig& other);

/// Place of a machine, from its link.
struct MachinePlace {
  explicit MachinePlace(const LinkConfig& link);
  /// True unless the two are certainly different serial ports, or different hosts. Ignores `port`.
  bool may_be(const MachinePlace& other) const;

  bool is_serial = false;
  /// Places of one scope are the same only with the same id: the kernel's names of serial ports,
  /// those of /dev/serial/by-id, and IP addresses. A host name may stand for any address, and
  /// another path for any port, so both are empty.
  std::string scope;
  std::string id;
  std::uint16_t port = 0;  ///< of the host; 0 for a serial port
};

class LocalDevices final {
 public:
  /// `local`, the config of the file, must outlive the object.
  explicit LocalDevices(const Config& local);

  /// A device as the local file has it.
  struct Known {
    const DeviceConfig* device = nullptr;  ///< nullptr: it is new
    std::string why_new;                   ///< "the local file has no device of this name"
  };
  /// Returns the local device that `device`, at `link`, is: name, protocol, options of the
  /// protocol, and place are the same.
  Known find(const DeviceConfig& device, const LinkConfig& link) const;

  /// Returns why the new `device` may be a local machine under another model, or one behind a PLC;
  /// empty if it is neither.
  std::string doubt(const DeviceConfig& device, const LinkConfig& link) const;

 private:
  const Config& local_;
  std::unordered_map<std::string_view, const DeviceConfig*> names_;
  std::vector<MachinePlace> places_;  ///< of Config::links
};

}  // namespace fxagent
