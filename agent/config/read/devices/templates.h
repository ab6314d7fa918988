// Makes many devices from one description: `templates`, and a device's `template` and `n`.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "agent/config/json/tree.h"
#include "agent/config/read/reader.h"

namespace fxagent {

/// Groups and tags of a template or of an entry, as nodes of the file.
class DeviceLists {
 public:
  explicit DeviceLists(const ConfigNode& node);

  const ConfigNode& node() const { return *node_; }
  /// Returns the items of `key`, the groups or the tags. Parses them once for all devices.
  const std::vector<ConfigNode>& items(ConfigReader& reader, KeyRef key);
  /// Returns the bytes that the node takes in the file, except `n`.
  std::size_t size() const { return size_; }
  /// Returns the bytes that the addresses of `commands.allow` take in a device.
  std::size_t allowed_size() const;
  /// Records that a device uses this template.
  void use() { is_used_ = true; }
  bool is_used() const { return is_used_; }

 private:
  const ConfigNode* node_;
  bool is_used_ = false;
  std::size_t size_ = 0;
  std::map<std::string_view, std::vector<ConfigNode>> items_;  ///< by key
};

/// One entry of `devices`, with the members that its template adds. Does not copy: other nodes
/// point at its members as their parents.
class DeviceEntry final {
 public:
  DeviceEntry(const ConfigNode& node, DeviceLists* base, std::vector<std::string> n);
  DeviceEntry(const DeviceEntry&) = delete;
  DeviceEntry& operator=(const DeviceEntry&) = delete;

  /// Returns the number of devices that it makes.
  std::size_t count() const { return n_.empty() ? 1 : n_.size(); }
  /// True if it has a template or an `n`; otherwise it is a device written out in full.
  bool is_made() const { return base_ != nullptr || !n_.empty(); }
  /// Makes only the first device from now on.
  void keep_first() { n_.resize(1); }
  DeviceOrigin origin(std::size_t i) const;

  /// Returns the entry as it stands in the file.
  const ConfigNode& node() const { return own_.node(); }
  /// Returns an object with the entry's own members, and those of the template that it does not
  /// override. The members keep their positions in the file.
  const ConfigNode& members() const { return members_; }
  /// Returns the member of the entry, or else of the template, as it stands in the file; nullptr if
  /// neither has it.
  const ConfigNode* in_file(std::string_view key) const;

  /// Returns the groups or the tags: the items of the template, then those of the entry. An item of
  /// the entry replaces the template's item with the same name. Names are compared with the
  /// reader's current origin. The nodes stay valid as long as the entry and the templates do.
  std::vector<const ConfigNode*> items(ConfigReader& reader, KeyRef key);

 private:
  DeviceLists own_;
  DeviceLists* base_;
  std::vector<std::string> n_;
  ConfigNode members_;
};

class Templates final {
 public:
  /// Most devices of one entry.
  static constexpr std::size_t max_devices = 10'000;

  /// Reads the templates of the file. `top` is its root. Reports faults to `reader`. Both must
  /// outlive the object.
  Templates(ConfigReader& reader, const ConfigNode& top);

  /// Returns the entry at `node`; nullptr if its `template` or `n` is wrong, which is reported. An
  /// entry that is not an object is returned unchanged.
  std::unique_ptr<DeviceEntry> entry(const ConfigNode& node);

  /// Warns of templates that no device uses. Call after the last entry.
  void warn_of_unused();

 private:
  DeviceLists* template_of(const ConfigNode& node, const ConfigNode& given);
  std::optional<std::vector<std::string>> read_n(const ConfigNode& given, const ConfigNode& node);
  bool has_room(const ConfigNode& node, const DeviceLists* base, const std::vector<std::string>& n);
  bool can_have_names(const DeviceEntry& entry);

  ConfigReader& reader_;
  std::map<std::string, DeviceLists, std::less<>> templates_;
  std::uint64_t bytes_ = 0;  ///< size of the entries so far, if written out in full
};

}  // namespace fxagent
