// What one device refuses to give although its documents allow it: registers that are not there,
// blocks that are too long, commands for several places at once. Each refused read is halved until
// what is left tells which. Pure: time is an argument. Field thread.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "agent/messages.h"
#include "protocol/plan.h"

namespace fxagent {

class HoleMap final {
 public:
  /// What the next plan must keep to.
  const Holes& holes() const { return holes_; }
  /// Rises whenever holes() changes.
  std::uint32_t version() const { return version_; }

  /// The device refused to be read like this. With `halves` both are tried by themselves from now
  /// on; without them it is missing, and left out until a retry. `asked`: what asked_in() says of
  /// it, where the device's codec may put that into a Gather with others; else empty.
  void refused(const Span& read, const std::optional<Halves>& halves, SteadyTime now,
               const std::vector<Span>& asked = {});
  /// The device refused these reads in one Gather, which asked_in() says were `asked` for: from now
  /// on they go in halves, apart from others. Where all that was asked for can be read, by whatever
  /// way, there were too many. One that was the only part is read by another way from now on.
  void refused_together(const Gather& gather, const std::vector<Span>& asked);
  /// A Gather of so many parts was answered; read() says which.
  void read_together(std::size_t parts);
  /// The device said nothing, or nonsense, to a Gather by the command: it may be the command that
  /// it stumbles over. None goes out by it until the device has answered something else.
  void unanswered(std::uint8_t gather);
  /// What an answer with data means for commands that went unanswered.
  struct Proof {
    bool again = false;                 ///< some are to be tried again now
    std::vector<std::uint8_t> lacking;  ///< these it seems to lack
  };
  /// The device has answered a Gather by the command, or, with 0, a read by itself.
  Proof answered(std::uint8_t gather);
  /// The device does not know the command: no Gather by it until a retry. True where it was not
  /// found to lack it before.
  bool lacks(std::uint8_t gather, SteadyTime now);

  /// The device was read like this. Where both halves of a refused read are good, either what lies
  /// between them is missing, or, with nothing between, the whole was too long.
  void read(const Span& read);

  /// What is missing may be there by now (a new program, another device): where the time has come,
  /// each is asked for again, apart from its neighbours so that they stay good whatever comes. So
  /// are commands that it did not know, or not then (a password, a wrong setting). How few parts it
  /// takes in one Gather, and what it gives by itself only, is found anew: after ten minutes, then
  /// ever more seldom, once a day in the end.
  void retry(SteadyTime now);

 private:
  /// A cut that is being tried, or was found to be needed.
  struct Border {
    Holes::Cut cut;
    Span reason;  ///< the refused read that it is to explain
    std::uint32_t left_end = 0;
    bool left_read = false;
    bool right_read = false;
  };

  void changed();
  void explained(const Span& span);
  void learn_limit(std::uint16_t space, std::uint32_t bits);

  /// A command of which some Gathers went unanswered since it was answered last.
  struct Doubt {
    std::uint8_t gather = 0;
    bool waits = false;       ///< for the answer to something else
    int proofs = 0;           ///< how often that came
    std::uint32_t parts = 0;  ///< what the command was limited to
  };
  /// A command that was refused with the suspects, and half of the fewest parts of that.
  struct Refused {
    std::uint8_t gather = 0;
    std::uint32_t half = 0;
  };

  void limit_parts(std::uint8_t gather, std::uint32_t parts);
  std::uint32_t parts_of(std::uint8_t gather) const;
  void too_many_parts();
  void retry_commands(SteadyTime now);
  void forgive(SteadyTime now);
  bool is_suspect(const Span& span) const;
  void suspect(const Span& read, const std::vector<Span>& asked);
  void cleared(const Span& read);

  std::vector<Border> borders_;
  bool is_gathered_ = false;  ///< what is tried by itself may go into a Gather with others
  /// Empty: there are no suspects, or they are of a hole that was found.
  std::vector<Refused> refused_gathers_;
  std::vector<Doubt> doubts_;
  std::vector<std::uint8_t> lacking_;  ///< commands that it lacked at some time
  SteadyTime commands_retry_at_{};
  std::optional<SteadyTime> forgive_at_;
  std::chrono::seconds forgive_after_{600};
  std::vector<Span> asked_again_;  ///< missing ones under retry
  Holes holes_;
  std::uint32_t version_ = 0;
  SteadyTime retry_at_{};
  std::chrono::seconds retry_after_{0};
};

}  // namespace fxagent
