// Plans of the groups of one link. Adapts them to what its devices refuse or leave unanswered, and
// searches a refused read for the missing places. Field thread.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>
#include <vector>

#include "agent/field/bus/bus.h"
#include "agent/field/link/link_device.h"
#include "protocol/codec.h"
#include "protocol/plan/plan.h"

namespace fxagent {

class GroupPlans final {
 public:
  explicit GroupPlans(const LinkParts& link) : link_(link) {}

  /// Makes a new plan. A running cycle begins anew.
  void make(LinkDevice& device, GroupPoll& group);
  void make_all(LinkDevice& device);
  /// Makes a new plan if the holes or the turnaround of the device have changed since the last one.
  void refresh(LinkDevice& device, GroupPoll& group);
  /// Returns the line time of the longest exchange under the current plans.
  std::chrono::nanoseconds longest_poll() const;

  /// Records that the device refused these reads, sent as `request`, because of a missing place.
  void refused(LinkDevice& device, GroupPoll& group, ReadIndices reads, const Request& request,
               const Exchange& exchange);
  /// Reads in parts, in this cycle, what was refused because something in it is missing.
  void read_in_parts(LinkDevice& device, GroupPoll& group, ReadIndices reads,
                     std::chrono::nanoseconds line_time);
  /// Records that the device answered these reads with data.
  void were_read(LinkDevice& device, const GroupPoll& group, ReadIndices reads);

  /// Records that the device lacks this command. All its groups get plans without it.
  void give_up_command(LinkDevice& device, std::uint8_t gather, const std::string& reason);
  /// Records a Gather without a good answer, if its parts can also be read separately.
  void doubt_command(LinkDevice& device, const Request& request);
  /// Records an answer with data. True if all groups of the device have new plans because of it.
  bool proves_command(LinkDevice& device, const Request& request);

 private:
  Plan plan_of(const LinkDevice& device, const GroupPoll& group,
               const std::vector<Point>& points) const;
  /// Reads `points` by a plan of their own under the holes known by now. False: its exchanges would
  /// exceed the bound of a waiting command.
  bool read_by_other_ways(LinkDevice& device, GroupPoll& group,
                          const std::vector<std::uint32_t>& points);

  const LinkParts link_;
};

}  // namespace fxagent
