// What one device refuses to give although its documents allow it: registers that are not there,
// blocks that are too long. Each refused read is halved until what is left tells which. Pure: time
// is an argument. Field thread.
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
  /// on; without them it is missing, and left out until a retry.
  void refused(const Span& read, const std::optional<Halves>& halves, SteadyTime now);

  /// The device was read like this. Where both halves of a refused read are good, either what lies
  /// between them is missing, or, with nothing between, the whole was too long.
  void read(const Span& read);

  /// What is missing may be there by now (a new program, another device): where the time has come,
  /// each is asked for again, apart from its neighbours so that they stay good whatever comes.
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

  std::vector<Border> borders_;
  std::vector<Span> asked_again_;  ///< missing ones under retry
  Holes holes_;
  std::uint32_t version_ = 0;
  SteadyTime retry_at_{};
  std::chrono::seconds retry_after_{0};
};

}  // namespace fxagent
