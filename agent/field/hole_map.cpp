#include "agent/field/hole_map.h"

#include <algorithm>
#include <limits>

namespace fxagent {
namespace {

using std::chrono::seconds;

// A device that was starting is asked again soon, one that lacks a register seldom.
constexpr seconds kFirstRetry{10};
constexpr seconds kLongestRetry{600};
constexpr std::uint32_t kAny = std::numeric_limits<std::uint32_t>::max();

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

void HoleMap::refused(const Span& read, const std::optional<Halves>& halves, SteadyTime now,
                      const std::vector<Span>& asked) {
  if (std::erase_if(holes_.suspects, [&](const Span& span) { return overlap(span, read); }) > 0)
    refused_gather_ = 0;  // this one it was, or one of these
  is_gathered_ = !asked.empty();
  if (halves && is_gathered_) {
    // Whatever goes together with one of them might be refused for it.
    if (holes_.suspects.empty()) holes_.most_suspects = holes_.most_others = kAny;
    suspect({read.space, read.first_bit, halves->left_end - read.first_bit}, asked);
    suspect({read.space, halves->right_first, read.end_bit() - halves->right_first}, asked);
  }
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

void HoleMap::refused_together(const Gather& gather, const std::vector<Span>& asked) {
  if (gather.parts.size() == 1) {
    const Span& span = gather.parts.front().span;
    std::erase_if(holes_.suspects, [&](const Span& suspect) { return overlap(suspect, span); });
    refused_gather_ = 0;  // this one it was
    holes_.apart.push_back(span);
    return changed();
  }
  const auto half = static_cast<std::uint32_t>((gather.parts.size() + 1) / 2);
  if (holes_.suspects.empty()) {
    holes_.most_suspects = holes_.most_others = kAny;
    refused_gather_ = gather.parts.front().gather;
  }
  holes_.most_suspects = std::min(holes_.most_suspects, half);
  for (const Read& part : gather.parts) {
    if (is_suspect(part.span)) continue;
    // Or what was believed to be good is too much at once.
    holes_.most_others = std::min(holes_.most_others, half);
    suspect(part.span, asked);
  }
  changed();
}

void HoleMap::read_together(std::size_t parts) {
  if (!holes_.suspects.empty())
    holes_.most_others = std::max(holes_.most_others, static_cast<std::uint32_t>(parts));
}

bool HoleMap::lacks(std::uint8_t gather, SteadyTime now) {
  holes_.suspects.clear();
  refused_gather_ = 0;
  limit_parts(gather, 0);
  commands_retry_at_ = now + kLongestRetry;
  changed();
  if (std::find(lacking_.begin(), lacking_.end(), gather) != lacking_.end()) return false;
  lacking_.push_back(gather);
  return true;
}

void HoleMap::retry_commands(SteadyTime now) {
  if (lacking_.empty() || now < commands_retry_at_) return;
  const auto retried =
      std::erase_if(holes_.gather_limits, [](const auto& limit) { return limit.parts == 0; });
  if (retried > 0) changed();
}

void HoleMap::limit_parts(std::uint8_t gather, std::uint32_t parts) {
  std::erase_if(holes_.gather_limits, [&](const auto& limit) { return limit.gather == gather; });
  holes_.gather_limits.push_back({gather, parts});
}

bool HoleMap::is_suspect(const Span& span) const {
  return std::any_of(holes_.suspects.begin(), holes_.suspects.end(),
                     [&](const Span& one) { return overlap(one, span); });
}

/// Only what was asked for: nobody may ever read the rest of `read` again.
void HoleMap::suspect(const Span& read, const std::vector<Span>& asked) {
  for (const Span& span : asked) {
    if (!overlap(span, read)) continue;
    const std::uint32_t first = std::max(span.first_bit, read.first_bit);
    holes_.suspects.push_back(
        {span.space, first, std::min(span.end_bit(), read.end_bit()) - first});
  }
}

/// What was read is above suspicion. The last one gone without a hole: there were too many of them.
void HoleMap::cleared(const Span& read) {
  std::vector<Span> left;
  for (const Span& span : holes_.suspects) {
    if (!overlap(span, read)) {
      left.push_back(span);
      continue;
    }
    if (span.first_bit < read.first_bit)
      left.push_back({span.space, span.first_bit, read.first_bit - span.first_bit});
    if (read.end_bit() < span.end_bit())
      left.push_back({span.space, read.end_bit(), span.end_bit() - read.end_bit()});
  }
  if (left == holes_.suspects) return;
  holes_.suspects = std::move(left);
  if (!holes_.suspects.empty()) return;
  if (refused_gather_ != 0) limit_parts(refused_gather_, holes_.most_suspects);
  refused_gather_ = 0;
  changed();
}

void HoleMap::read(const Span& read) {
  if (!holes_.suspects.empty()) cleared(read);
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
  retry_commands(now);
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
    if (is_gathered_) holes_.apart.push_back(span);
  }
  holes_.missing.clear();
  changed();
}

}  // namespace fxagent
