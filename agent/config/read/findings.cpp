#include "agent/config/read/findings.h"

#include <algorithm>
#include <utility>

namespace fxagent {

void Findings::add(std::uint32_t offset, const ConfigNode& at, std::string text,
                   const DeviceOrigin* origin, std::uint32_t device) {
  if (is_full() && !knows(offset, origin) &&
      (origin == nullptr || !by_text_.contains({offset, text})))
    return leave_out(offset, origin);
  const bool of_key = offset != at.offset;
  if (origin == nullptr) {
    list_.push_back({offset, pointer_to(at), std::move(text), of_key});
    return;
  }
  if (!by_entry_.empty() && by_entry_.begin()->first.second != origin->entry) by_entry_.clear();
  auto known = by_entry_.try_emplace({offset, origin->entry}, list_.size()).first;
  if (known->second == list_.size()) {
    const auto [same, fresh] = by_text_.try_emplace({offset, text}, list_.size());
    if (!fresh) known->second = same->second;
  }
  if (known->second < list_.size()) {
    Finding& first = list_[known->second];
    if (first.device != device) {
      first.device = device;
      ++first.more;
      return;
    }
    // A second fault of this device at this place. A later device repeats those of the first one.
    if (first.more > 0) return;
    if (is_full()) return leave_out(offset, origin);
  }
  list_.push_back({offset, pointer_to(at), std::move(text), of_key, *origin, device});
}

void Findings::leave_out(std::uint32_t offset, const DeviceOrigin* origin) {
  if (origin != nullptr) {
    if (offset >= left_out_.size()) left_out_.resize(offset + std::size_t{1});
    if (left_out_[offset]) return;
    left_out_[offset] = true;
  }
  ++unlisted_;
}

std::string unlisted_text(std::size_t unlisted) {
  return std::to_string(unlisted) +
         (unlisted == 1 ? " more is not listed" : " more are not listed");
}

ConfigError unlisted_error(std::size_t unlisted) {
  return {"", 0, unlisted_text(unlisted), /*of_key=*/false, unlisted};
}

ConfigErrors Findings::in_order(const ConfigTree& tree) const {
  std::vector<Finding> sorted = list_;
  std::ranges::stable_sort(sorted, {}, &Finding::offset);
  ConfigErrors list;
  if (unlisted_ > 0) list.push_back(unlisted_error(unlisted_));
  for (const Finding& finding : sorted)
    list.push_back(
        {finding.pointer, tree.line_of(finding.offset), text_of(finding, tree), finding.of_key});
  return list;
}

std::string Findings::text_of(const Finding& finding, const ConfigTree& tree) {
  const DeviceOrigin& origin = finding.origin;
  if (origin.entry == nullptr) return finding.text;
  std::string text = finding.text + "; ";
  const bool is_in_template =
      origin.base != nullptr && (finding.pointer + "/").starts_with(pointer_to(*origin.base) + "/");
  if (is_in_template)
    text += "for the device at " + tree.place_of(*origin.entry);
  else if (origin.base != nullptr)
    text += "its template is at " + tree.place_of(*origin.base);
  if (!origin.n.empty())
    text += (origin.base != nullptr ? ", {n} being " : "{n} being ") + shown(origin.n);
  if (finding.more > 0)
    text +=
        ", and for " + std::to_string(finding.more) + (finding.more == 1 ? " other" : " others");
  return text;
}

}  // namespace fxagent
