// Devices that are written once and made many times: `templates`, and the keys `template` and `n`
// of a device.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <tl/expected.hpp>
#include <vector>

#include "agent/config/reader.h"
#include "agent/config/tree.h"

namespace fxagent {

/// What `{n}` stands for in turn: "1-40", "01-12,15". The first of a range that begins with a 0 has
/// them all padded to its length. The error is a sentence.
tl::expected<std::vector<std::string>, std::string> numbers_of_range(std::string_view text);

/// Groups and tags of a template or of an entry, as nodes of the file. They are read when they are
/// first asked for, and once for all devices.
class DeviceLists {
 public:
  explicit DeviceLists(const ConfigNode& node);

  const ConfigNode& node() const { return *node_; }
  const std::vector<ConfigNode>& groups(ConfigReader& reader);
  const std::vector<ConfigNode>& tags(ConfigReader& reader);
  /// Bytes that they take in the file, with all else that each device is given.
  std::size_t size() const { return size_; }
  /// Bytes that the addresses of `commands.allow` take in a device.
  std::size_t allowed_size() const;

 private:
  const ConfigNode* node_;
  std::size_t size_ = 0;
  std::optional<std::vector<ConfigNode>> groups_;
  std::optional<std::vector<ConfigNode>> tags_;
};

/// One entry of `devices` with what its template adds to it. Not to be copied: its members are the
/// parents of others.
class DeviceEntry final {
 public:
  DeviceEntry(const ConfigNode& node, DeviceLists* base, std::vector<std::string> n);
  DeviceEntry(const DeviceEntry&) = delete;
  DeviceEntry& operator=(const DeviceEntry&) = delete;

  /// Devices that it makes.
  std::size_t count() const { return n_.empty() ? 1 : n_.size(); }
  /// Whether it is more than a device written out.
  bool is_made() const { return base_ != nullptr || !n_.empty(); }
  /// Of device `i`.
  DeviceOrigin origin(std::size_t i) const;

  /// As it stands in the file.
  const ConfigNode& node() const { return own_.node(); }
  /// An object with its own members, and those of the template that it does not have. They know
  /// where in the file they stand.
  const ConfigNode& members() const { return members_; }
  /// The member as it stands in the file, there or in the template; nullptr: in neither.
  const ConfigNode* in_file(std::string_view key) const;

  /// The template's, then its own; those of the same name take the template's place. For the
  /// reader's present origin; nodes stay as long as the entry and the templates.
  std::vector<const ConfigNode*> groups(ConfigReader& reader);
  std::vector<const ConfigNode*> tags(ConfigReader& reader);

 private:
  DeviceLists own_;
  DeviceLists* base_;
  std::vector<std::string> n_;
  ConfigNode members_;
};

class Templates final {
 public:
  /// The most devices of one entry.
  static constexpr std::size_t max_devices = 10'000;

  /// `top`: the whole file. What is wrong goes to the reader; both must outlive this.
  Templates(ConfigReader& reader, const ConfigNode& top);

  /// nullptr where the entry cannot be read for its `template` or `n`, which has been reported. An
  /// entry that is no object at all comes back as it is.
  std::unique_ptr<DeviceEntry> entry(const ConfigNode& node);

  /// To be called behind the last entry.
  void warn_of_unused();

 private:
  struct Template {
    DeviceLists lists;
    bool is_used = false;
  };

  Template* template_of(const ConfigNode& node, const ConfigNode& given);
  std::optional<std::vector<std::string>> read_n(const ConfigNode& given, const ConfigNode& node);
  bool has_room(const ConfigNode& node, const Template* base, const std::vector<std::string>& n);
  bool can_have_names(const DeviceEntry& entry);

  ConfigReader& reader_;
  std::map<std::string, Template, std::less<>> templates_;
  std::uint64_t bytes_ = 0;  ///< what the entries so far would take if they were written out
};

}  // namespace fxagent
