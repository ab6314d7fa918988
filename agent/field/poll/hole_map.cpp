#include "agent/field/poll/hole_map.h"

#include <algorithm>
#include <limits>

namespace fxagent {
namespace {

using std::chrono::seconds;

// A device that was starting is asked again soon; a device without the register is asked rarely.
constexpr seconds kFirstRetry{10};
constexpr seconds kLongestRetry{600};
// Limits that take several bad cycles to find are rarely lifted.
constexpr seconds kLongestForgiving{86'400};
// More suspects than this are not examined one by one: the Gather had too many parts.
constexpr std::size_t kMostSuspects = 256;
// A device lacks a command that goes unanswered this often while it answers something else.
constexpr int kProofs = 2;
constexpr std::uint32_t kLongestScalar = 64;  // bits
constexpr std::uint32_t kAny = std::numeric_limits<std::uint32_t>::max();

void add(std::vector<Span>& spans, const Span& span) {
  if (std::ranges::find(spans, span) == spans.end()) spans.push_back(span);
}

/// `parts` kAny: no limit.
void limit_parts(Holes& holes, std::uint8_t gather, std::uint32_t parts) {
  std::erase_if(holes.gather_limits, [&](const auto& limit) { return limit.gather == gather; });
  if (parts != kAny) holes.gather_limits.push_back({gather, parts});
}

std::uint32_t parts_of(const Holes& holes, std::uint8_t gather) {
  const auto limit = std::ranges::find(holes.gather_limits, gather, &Holes::GatherLimit::gather);
  return limit == holes.gather_limits.end() ? kAny : limit->parts;
}

void limit_reads(std::vector<Holes::Limit>& limits, const Holes::Limit& limit) {
  const auto known = std::ranges::find(limits, limit.space, &Holes::Limit::space);
  if (known == limits.end())
    limits.push_back(limit);
  else
    known->bits = std::min(known->bits, limit.bits);
}

bool is_suspect(const Holes& holes, const Span& span) {
  return std::ranges::any_of(holes.suspects, [&](const Span& one) { return overlap(one, span); });
}

/// Suspects only what was asked for, because the rest of `read` may never be read again.
void suspect(Holes& holes, const Span& read, const std::vector<Span>& asked) {
  for (const Span& span : asked) {
    if (!overlap(span, read)) continue;
    const std::uint32_t first = std::max(span.first_bit, read.first_bit);
    holes.suspects.push_back({span.space, first, std::min(span.end_bit(), read.end_bit()) - first});
  }
}

}  // namespace

void HoleMap::changed() {
  holes_.cuts.clear();
  for (const Border& border : borders_) holes_.cuts.push_back(border.cut);
  ++version_;
}

/// Removes the borders that were tried on the way to `span`; their work is done.
void HoleMap::explained(const Span& span) {
  std::erase_if(borders_, [&](const Border& border) { return border.reason.contains(span); });
}

void HoleMap::refused(const Span& read, const std::optional<Halves>& halves, SteadyTime now,
                      const std::vector<Span>& asked) {
  if (std::erase_if(holes_.suspects, [&](const Span& span) { return overlap(span, read); }) > 0)
    refused_gathers_.clear();  // the cause was this span, or one of these
  is_gathered_ = !asked.empty();
  if (halves && is_gathered_) {
    // A Gather with one of them might be refused because of it.
    if (holes_.suspects.empty()) holes_.most_suspects = holes_.most_others = kAny;
    suspect(holes_, {read.space, read.first_bit, halves->left_end - read.first_bit}, asked);
    suspect(holes_, {read.space, halves->right_first, read.end_bit() - halves->right_first}, asked);
  }
  if (halves) {
    borders_.push_back(
        {.cut = {read.space, halves->right_first}, .reason = read, .left_end = halves->left_end});
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
    refused_gathers_.clear();  // this span was the cause
    add(holes_.never_gathered, span);
    return changed();
  }
  const auto half = static_cast<std::uint32_t>((gather.parts.size() + 1) / 2);
  const std::uint8_t command = gather.parts.front().gather;
  if (holes_.suspects.empty()) holes_.most_suspects = holes_.most_others = kAny;
  if (holes_.suspects.empty() || !refused_gathers_.empty()) {
    const auto known = std::ranges::find(refused_gathers_, command, &Refused::gather);
    if (known == refused_gathers_.end())
      refused_gathers_.push_back({command, half});
    else
      known->half = std::min(known->half, half);
  }
  holes_.most_suspects = std::min(holes_.most_suspects, half);
  for (const Read& part : gather.parts) {
    if (is_suspect(holes_, part.span)) continue;
    // Or the parts that seemed good are too many at once.
    holes_.most_others = std::min(holes_.most_others, half);
    suspect(holes_, part.span, asked);
  }
  if (holes_.suspects.size() > kMostSuspects) {
    if (refused_gathers_.empty()) refused_gathers_.push_back({command, half});
    holes_.suspects.clear();
    too_many_parts();
  }
  changed();
}

void HoleMap::unanswered(std::uint8_t gather) {
  const auto known = std::ranges::find(doubts_, gather, &Doubt::gather);
  Doubt& doubt =
      known == doubts_.end() ? doubts_.emplace_back(Doubt{gather, false, 0, kAny}) : *known;
  if (parts_of(holes_, gather) == 0) return;
  doubt.parts = parts_of(holes_, gather);
  doubt.waits = true;
  limit_parts(holes_, gather, 0);
  changed();
}

HoleMap::Proof HoleMap::answered(std::uint8_t gather) {
  Proof proof;
  for (Doubt& doubt : doubts_) {
    if (doubt.gather != gather && doubt.waits && ++doubt.proofs >= kProofs) {
      proof.lacking.push_back(doubt.gather);
      doubt.proofs = kProofs - 1;  // next time, one is enough
    } else if (doubt.waits) {
      limit_parts(holes_, doubt.gather, doubt.parts);
      proof.again = proof.again || doubt.gather != gather;
      changed();
    }
    doubt.waits = false;
  }
  std::erase_if(doubts_, [&](const Doubt& doubt) { return doubt.gather == gather; });
  return proof;
}

bool HoleMap::lacks(std::uint8_t gather, SteadyTime now) {
  holes_.suspects.clear();
  refused_gathers_.clear();
  limit_parts(holes_, gather, 0);
  commands_retry_at_ = now + kLongestRetry;
  changed();
  if (std::ranges::find(lacking_, gather) != lacking_.end()) return false;
  lacking_.push_back(gather);
  return true;
}

void HoleMap::retry_commands(SteadyTime now) {
  if (lacking_.empty() || now < commands_retry_at_) return;
  const auto retried =
      std::erase_if(holes_.gather_limits, [](const auto& limit) { return limit.parts == 0; });
  if (retried > 0) changed();
}

void HoleMap::forgive(SteadyTime now) {
  const auto is_few = [](const Holes::GatherLimit& limit) { return limit.parts > 0; };
  // Missing spans under retry are kept apart for another reason.
  const auto is_apart = [&](const Span& span) {
    return std::ranges::find(asked_again_, span) == asked_again_.end();
  };
  if (std::ranges::none_of(holes_.gather_limits, is_few) &&
      std::ranges::none_of(holes_.never_gathered, is_apart) && holes_.limits.empty() &&
      std::ranges::none_of(borders_, &Border::is_needed))
    return forgive_at_.reset();
  if (!forgive_at_) forgive_at_ = now + forgive_after_;
  if (now < *forgive_at_) return;
  forgive_at_.reset();
  forgive_after_ = std::min(forgive_after_ * 2, kLongestForgiving);
  std::erase_if(holes_.gather_limits, is_few);
  std::erase_if(holes_.never_gathered, is_apart);
  holes_.limits.clear();
  std::erase_if(borders_, [](const Border& border) { return border.is_needed(); });
  changed();
}

void HoleMap::too_many_parts() {
  for (const Refused& refused : refused_gathers_)
    limit_parts(holes_, refused.gather, std::min(parts_of(holes_, refused.gather), refused.half));
  refused_gathers_.clear();
}

/// Clears what was read of suspicion. If the last suspect is cleared without a hole, the Gather had
/// too many parts.
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
  too_many_parts();
  changed();
}

void HoleMap::read(const Span& read, std::size_t parts) {
  if (!holes_.suspects.empty()) {
    holes_.most_others = std::max(holes_.most_others, static_cast<std::uint32_t>(parts));
    cleared(read);
  }
  std::erase_if(command_limits_, [&](const Holes::Limit& limit) {
    return limit.space == read.space && limit.bits < read.bits;
  });
  const bool back = std::erase_if(asked_again_, [&](const Span& span) {
                      if (!read.contains(span)) return false;
                      std::erase(holes_.never_gathered, span);
                      return true;
                    }) > 0;
  // Borders tried inside a span that can be read as a whole are not needed.
  const auto needless =
      std::erase_if(borders_, [&](const Border& border) { return read.contains(border.reason); });
  if (back || needless > 0) changed();
  for (Border& border : borders_) {
    if (border.cut.space != read.space || border.is_needed()) continue;
    if (read.first_bit <= border.reason.first_bit && read.end_bit() == border.left_end)
      border.left_read = true;
    if (read.first_bit == border.cut.at && read.end_bit() >= border.reason.end_bit())
      border.right_read = true;
    if (!border.is_needed()) continue;
    const Border found = border;
    explained(found.reason);
    const std::uint32_t left = found.left_end - found.reason.first_bit;
    const std::uint32_t longer = std::max(left, found.reason.bits - left);
    if (found.left_end == found.cut.at && longer >= kLongestScalar) {
      learn_limit(found.cut.space, longer);
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
  limit_reads(holes_.limits, {space, bits});
  limit_reads(command_limits_, {space, bits});
}

void HoleMap::retry(SteadyTime now) {
  retry_commands(now);
  forgive(now);
  if (holes_.missing.empty() || now < retry_at_) return;
  retry_after_ = std::min(retry_after_ * 2, kLongestRetry);
  retry_at_ = now + retry_after_;
  for (const Span& span : holes_.missing) {
    for (const std::uint32_t at : {span.first_bit, span.end_bit()})
      borders_.push_back({.cut = {span.space, at}, .reason = span});
    add(asked_again_, span);
    if (is_gathered_) add(holes_.never_gathered, span);
  }
  holes_.missing.clear();
  changed();
}

}  // namespace fxagent
