#include "agent/field/poll/poll_grid.h"

namespace fxagent {

using std::chrono::milliseconds;

milliseconds grid_of(milliseconds interval) {
  for (const milliseconds grid :
       {milliseconds(10), milliseconds(5), milliseconds(2), milliseconds(1)})
    if (grid * 100 <= interval && interval % grid == milliseconds(0)) return grid;
  return milliseconds(0);
}

SteadyTime on_grid(SteadyTime due, milliseconds interval) {
  const milliseconds grid = grid_of(interval);
  if (grid.count() == 0) return due;
  const auto beyond = due.time_since_epoch() % grid;
  return beyond.count() == 0 ? due : due - beyond + grid;
}

}  // namespace fxagent
