#include "agent/field/bus/late_answers.h"

#include <algorithm>

namespace fxagent {

void LateAnswers::given_up(Owed answer, SteadyTime ended, std::chrono::milliseconds timeout,
                           std::uint32_t bytes) {
  owed_ = std::max(owed_, answer);
  owed_bytes_ += bytes;
  over_at_ = std::max(over_at_, ended + std::clamp(timeout, kLeast, kMost));
}

}  // namespace fxagent
