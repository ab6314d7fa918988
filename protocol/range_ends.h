// Ranges as users write them: M100-M199, M100..M199, M100-199.
#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace fxagent {

/// Ends of a range as it is written, "M100-M199" or "M100..M199". For any other text, `first`
/// is the whole text and `last` is empty.
struct RangeEnds {
  std::string_view first;
  std::optional<std::string_view> last;
};
RangeEnds range_ends(std::string_view text);

/// Returns the last end in full: "M199" for "M100-199". `letters` are those of the first end: only
/// its protocol knows that the A of "WA0" is a digit. Returns the first end if there is no other.
std::string last_end(const RangeEnds& ends, std::string_view letters);

}  // namespace fxagent
