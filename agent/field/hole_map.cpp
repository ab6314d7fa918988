#include "agent/field/hole_map.h"

#include <algorithm>

namespace fxagent {
namespace {

using std::chrono::seconds;

// A device that was starting is asked again soon, one that lacks a register seldom.
constexpr seconds kFirstRetry{10};
constexpr seconds kLongestRetry{600};

}  // namespace

void HoleMap::changed() {
  holes_.cuts.clear();
  for (const Border& border : borders_) holes_.cuts.push_back(border.cut);
  ++version_;
}

/// The borders that were tried on the way to `span` have done their work.
void HoleMap::explained(const Span& span) {
  std::erase_if(borders_, [&](const Border& border) { return border.reason.contains(span); });
}

void HoleMap::refused(const Span& read, const std::optional<Halves>& halves, SteadyTime now) {
  if (halves) {
    Border border;
    border.cut = {read.space, halves->right_first};
    border.reason = read;
    border.left_end = halves->left_end;
    borders_.push_back(border);
  } else {
    explained(read);
    holes_.missing.push_back(read);
    const bool again = std::erase(asked_again_, read) > 0;
    if (!again || retry_after_ == seconds(0)) retry_after_ = kFirstRetry;
    retry_at_ = now + retry_after_;
  }
  changed();
}

void HoleMap::read(const Span& read) {
  const bool back = std::erase(asked_again_, read) > 0;
  // Whatever was tried inside of what can be read as a whole was tried in vain.
  const auto needless =
      std::erase_if(borders_, [&](const Border& border) { return read.contains(border.reason); });
  if (back || needless > 0) changed();
  for (Border& border : borders_) {
    if (border.cut.space != read.space || (border.left_read && border.right_read)) continue;
    if (read.first_bit <= border.reason.first_bit && read.end_bit() == border.left_end)
      border.left_read = true;
    if (read.first_bit == border.cut.at && read.end_bit() >= border.reason.end_bit())
      border.right_read = true;
    if (!border.left_read || !border.right_read) continue;
    const Border found = border;
    explained(found.reason);
    if (found.left_end == found.cut.at) {
      const std::uint32_t left = found.left_end - found.reason.first_bit;
      learn_limit(found.cut.space, std::max(left, found.reason.bits - left));
    } else {
      borders_.push_back(found);
    }
    return changed();
  }
}

void HoleMap::learn_limit(std::uint16_t space, std::uint32_t bits) {
  std::erase_if(borders_, [&](const Border& border) {
    return border.cut.space == space && border.left_end == border.cut.at;
  });
  for (Holes::Limit& limit : holes_.limits) {
    if (limit.space != space) continue;
    limit.bits = std::min(limit.bits, bits);
    return;
  }
  holes_.limits.push_back({space, bits});
}

void HoleMap::retry(SteadyTime now) {
  if (holes_.missing.empty() || now < retry_at_) return;
  retry_after_ = std::min(retry_after_ * 2, kLongestRetry);
  retry_at_ = now + retry_after_;
  for (const Span& span : holes_.missing) {
    for (const std::uint32_t at : {span.first_bit, span.end_bit()}) {
      Border border;
      border.cut = {span.space, at};
      border.reason = span;
      borders_.push_back(border);
    }
    asked_again_.push_back(span);
  }
  holes_.missing.clear();
  changed();
}

}  // namespace fxagent
