// What is wrong with a config file, or deserves a look, in the order of the file. Where one place
// of it stands for many devices, it is said once, with how many have it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "agent/config/tree.h"

namespace fxagent {

/// Of a device that has a template, or whose entry stands for many.
struct DeviceOrigin {
  const ConfigNode* entry = nullptr;  ///< in `devices`
  const ConfigNode* base = nullptr;   ///< its template; null: none
  std::string n;                      ///< what `{n}` stands for; empty: the entry has no `n`
};

/// "2000 more are not listed"; empty: all are.
std::string unlisted_text(std::size_t unlisted);

class Findings {
 public:
  /// So many are kept; a hostile file has one for each of its bytes.
  static constexpr std::size_t kMost = 1000;

  struct Finding {
    std::uint32_t offset = 0;
    std::string pointer;
    std::string text;
    DeviceOrigin origin{};  ///< of the first device that has it; no entry: it is in no such device
    std::uint32_t device = 0;  ///< the last device that has it
    std::uint32_t more = 0;    ///< devices beside the first
  };

  /// `origin`: null outside of such devices. `device` counts the devices that were made.
  void add(std::uint32_t offset, const ConfigNode& at, std::string text, const DeviceOrigin* origin,
           std::uint32_t device);

  bool empty() const { return list_.empty(); }
  /// Whether what is found at this byte for this entry has been said already.
  bool knows(std::uint32_t offset, const DeviceOrigin* origin) const {
    return origin != nullptr && by_entry_.contains({offset, origin->entry});
  }
  /// unlisted_text() of those that are not kept.
  std::string unlisted() const { return unlisted_text(unlisted_); }
  /// Sorted by their place; the order of those at one place is that of add().
  std::vector<Finding> in_order() const;
  /// The text, and for which devices: the device's place and that of its template, whichever is
  /// not that of the finding itself.
  static std::string text_of(const Finding& finding, const ConfigTree& tree);

 private:
  bool is_full() const { return list_.size() >= kMost; }

  std::vector<Finding> list_;
  std::size_t unlisted_ = 0;
  /// Indices in list_ of what was first found at an offset: by the entry it was found for, and by
  /// its text.
  std::map<std::pair<std::uint32_t, const ConfigNode*>, std::size_t> by_entry_;
  std::map<std::pair<std::uint32_t, std::string>, std::size_t> by_text_;
};

}  // namespace fxagent
