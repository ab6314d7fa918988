#include "tests/fleet/figures.h"

#include <algorithm>
#include <cmath>

namespace fxfleet {

using std::chrono::duration_cast;
using std::chrono::microseconds;

void Durations::add(Time::duration duration) {
  values_.push_back(static_cast<std::uint32_t>(duration_cast<microseconds>(duration).count()));
}

double Durations::percentile_ms(double share) const {
  if (values_.empty()) return 0;
  std::vector<std::uint32_t> sorted = values_;
  const double place = std::ceil(share * static_cast<double>(sorted.size())) - 1;
  const auto at = sorted.begin() + static_cast<std::ptrdiff_t>(std::max(0.0, place));
  std::nth_element(sorted.begin(), at, sorted.end());
  return *at / 1000.0;
}

std::size_t Figures::most_connects_in_a_second(std::size_t from) const {
  std::size_t most = 0;
  std::size_t first = from;
  for (std::size_t last = from; last < connacks.size(); ++last) {
    while (connacks[last] - connacks[first] >= std::chrono::seconds(1)) ++first;
    most = std::max(most, last - first + 1);
  }
  return most;
}

}  // namespace fxfleet
