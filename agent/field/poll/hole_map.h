// Finds out what one device refuses although its documents allow it: missing registers, blocks that
// are too long, frames with too many places (Gather). Plans then avoid it.
//
// Example: the PLC refuses a read of D100-D199, because it has no D150. The next plan reads
// D100-D149 and D150-D199 apart. The second is refused and halved again, until a read of D150 alone
// is refused: D150 is missing. Plans read D100-D149 and D151-D199 then, each in one frame, and try
// D150 again after 10 seconds, later every 10 minutes.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "agent/steady_time.h"
#include "protocol/plan/plan.h"

namespace fxagent {

/// One object for each device. Before a cycle call retry(), and make a new plan with holes() if
/// version() has changed. After each exchange report its outcome. Pure: time is an argument. Field
/// thread.
class HoleMap final {
 public:
  // ---- before a plan

  /// Returns the restrictions for make_plan(). version() rises with each change of them.
  const Holes& holes() const { return holes_; }
  std::uint32_t version() const { return version_; }
  /// Returns the limits for the reads of commands. A limit that retry() lifts stays here until a
  /// longer read succeeds: its trial with polls must not cost a command its deadline.
  const std::vector<Holes::Limit>& command_limits() const { return command_limits_; }
  /// Lifts restrictions whose time has come: a new program or device, a password or a setting may
  /// have removed their cause.
  ///
  /// * Missing spans are read again after 10 seconds, then at doubling intervals up to 10 minutes,
  ///   apart from their neighbours so that a refusal does not harm these.
  /// * Commands that the device did not know are tried again after 10 minutes.
  /// * All others (limits, needed cuts, spans that are never gathered) are found anew after 10
  ///   minutes, then at doubling intervals up to one day.
  void retry(SteadyTime now);

  // ---- after a read or a Gather

  /// Records a successful read. `parts` is the number of reads in its frame, 1 if it was sent
  /// alone. If both halves of a refused read are good, the gap between them is missing; without a
  /// gap the whole was too long. No limit is shorter than a value of 64 bits, which two reads could
  /// tear: then only that cut stays.
  void read(const Span& read, std::size_t parts = 1);
  /// Records that the device refused this read, sent alone. With `halves`, both are read separately
  /// afterwards. Without them, the span is missing. `asked` is the result of asked_in() if the
  /// device's codec may put the read into a Gather with others; otherwise empty.
  void refused(const Span& read, const std::optional<Halves>& halves, SteadyTime now,
               const std::vector<Span>& asked = {});
  /// Records that the device refused these reads in one Gather; `asked` is the result of
  /// asked_in(). Afterwards Gathers have half as many of them, and no others. If all that was asked
  /// for proves readable, by whatever way, the Gather had too many parts. A part that was refused
  /// on its own is read in another way afterwards.
  void refused_together(const Gather& gather, const std::vector<Span>& asked);

  // ---- commands for several places: a device may lack one, and not even answer it

  /// Records that a Gather by this command got no answer, or nonsense. No Gather uses the command
  /// until the device has answered something else.
  void unanswered(std::uint8_t gather);
  /// Result of answered().
  struct Proof {
    bool again = false;  ///< new plans should use a command again that was left out
    /// Commands that went unanswered several times while the device answered others: it seems to
    /// lack them.
    std::vector<std::uint8_t> lacking;
  };
  /// Records that the device answered a Gather by this command, or with 0 a single read. Returns
  /// what this shows of the commands that went unanswered.
  Proof answered(std::uint8_t gather);
  /// Records that the device lacks the command. No Gather uses it until retry() tries it again.
  /// True if this is new.
  bool lacks(std::uint8_t gather, SteadyTime now);

 private:
  /// A cut that is being tried, or that was found to be needed.
  struct Border {
    Holes::Cut cut;
    Span reason;  ///< the refused read that the cut may explain
    std::uint32_t left_end = 0;
    bool left_read = false;
    bool right_read = false;

    bool is_needed() const { return left_read && right_read; }
  };
  /// A command that was refused with the suspects, and half of the fewest parts in such a Gather.
  struct Refused {
    std::uint8_t gather = 0;
    std::uint32_t half = 0;
  };
  /// A command of which some Gathers went unanswered since its last answer.
  struct Doubt {
    std::uint8_t gather = 0;
    bool waits = false;       ///< until the device answers something else
    int proofs = 0;           ///< number of such answers
    std::uint32_t parts = 0;  ///< limit of the command before
  };

  void changed();
  void explained(const Span& span);
  void learn_limit(std::uint16_t space, std::uint32_t bits);
  void too_many_parts();
  void cleared(const Span& read);
  void retry_commands(SteadyTime now);
  void forgive(SteadyTime now);

  Holes holes_;
  std::uint32_t version_ = 0;
  std::vector<Holes::Limit> command_limits_;
  std::vector<Border> borders_;
  bool is_gathered_ = false;  ///< reads tried separately may go into a Gather with others
  /// Empty if there are no suspects, or if they belong to a hole that was found.
  std::vector<Refused> refused_gathers_;
  std::vector<Doubt> doubts_;
  std::vector<std::uint8_t> lacking_;  ///< commands that were lacking at some time
  std::vector<Span> asked_again_;      ///< missing spans under retry
  SteadyTime retry_at_{};              ///< of missing spans
  std::chrono::seconds retry_after_{0};
  SteadyTime commands_retry_at_{};
  std::optional<SteadyTime> forgive_at_;
  std::chrono::seconds forgive_after_{600};
};

}  // namespace fxagent
