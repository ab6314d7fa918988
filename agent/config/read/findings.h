// Errors or warnings of a config file, in the order of the file. If a template or an entry stands
// for many devices, a finding in it is reported once, with the number of devices that have it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "agent/config/json/tree.h"

namespace fxagent {

/// Source of a device that has a template, or whose entry makes several devices.
struct DeviceOrigin {
  const ConfigNode* entry = nullptr;  ///< item of `devices`
  const ConfigNode* base = nullptr;   ///< its template; nullptr if it has none
  std::string n;                      ///< replaces `{n}`; empty if the entry has no `n`
};

/// Returns "2000 more are not listed".
std::string unlisted_text(std::size_t unlisted);
/// Returns the same as an entry of a list of errors.
ConfigError unlisted_error(std::size_t unlisted);

class Findings {
 public:
  /// Most findings kept. A hostile file can have one for each of its bytes.
  static constexpr std::size_t kMost = 1000;

  /// Adds a finding. `origin` is nullptr if it belongs to no device with a DeviceOrigin. `device`
  /// differs from device to device. The devices of an entry must come one after the other.
  void add(std::uint32_t offset, const ConfigNode& at, std::string text, const DeviceOrigin* origin,
           std::uint32_t device);

  bool empty() const { return list_.empty(); }
  /// True if the list has a finding at this byte for this entry.
  bool knows(std::uint32_t offset, const DeviceOrigin* origin) const {
    return origin != nullptr && by_entry_.contains({offset, origin->entry});
  }
  /// Returns the findings sorted by offset, those at one offset in the order of add(). If some were
  /// not kept, the first entry is their number: a caller that shows only some does not cut it off.
  ConfigErrors in_order(const ConfigTree& tree) const;

 private:
  struct Finding {
    std::uint32_t offset = 0;
    std::string pointer;
    std::string text;
    bool of_key = false;
    DeviceOrigin origin{};     ///< of the first device that has the finding; unset if none does
    std::uint32_t device = 0;  ///< the last device that has it
    std::uint32_t more = 0;    ///< devices after the first
  };

  /// Returns the text and the devices it applies to. If the finding is in a template, the text
  /// names the place of the device; otherwise that of the template.
  static std::string text_of(const Finding& finding, const ConfigTree& tree);
  bool is_full() const { return list_.size() >= kMost; }
  /// Counts a finding that is not kept. Devices with one DeviceOrigin repeat theirs, so counts each
  /// place of those once.
  void leave_out(std::uint32_t offset, const DeviceOrigin* origin);

  std::vector<Finding> list_;
  std::size_t unlisted_ = 0;
  std::vector<bool> left_out_;  ///< by offset: a finding of a DeviceOrigin is counted
  // Index in list_ of the first finding at an offset: by its entry, and by its text.
  std::map<std::pair<std::uint32_t, const ConfigNode*>, std::size_t>
      by_entry_;  ///< of the last one
  std::map<std::pair<std::uint32_t, std::string>, std::size_t> by_text_;
};

/// Errors of a document from a possibly hostile sender, which may have one in every few bytes.
/// Keeps the first Findings::kMost and counts the others.
class ErrorList final {
 public:
  /// Adds a list of errors. Its entry with the number of further errors counts as that many.
  void add(ConfigErrors errors) {
    for (ConfigError& error : errors) add(std::move(error));
  }
  void add(ConfigError error) {
    if (error.unlisted > 0)
      unlisted_ += error.unlisted;
    else if (list_.size() < Findings::kMost)
      list_.push_back(std::move(error));
    else
      ++unlisted_;
  }
  bool empty() const { return list_.empty(); }

  /// Returns the errors; call it once. If some were not kept, the first entry is their number.
  std::vector<ConfigError> take() {
    if (unlisted_ > 0) list_.insert(list_.begin(), unlisted_error(unlisted_));
    return std::move(list_);
  }

 private:
  std::vector<ConfigError> list_;
  std::size_t unlisted_ = 0;
};

}  // namespace fxagent
