// Polls the devices of one link, one exchange at a time as the PollScheduler offers them. Sends the
// reads of GroupPlans, takes the answers, and publishes the sample of a group at the end of its
// cycle. ModelQuestions are steps as well. Field thread.
#pragma once

#include <asio/awaitable.hpp>
#include <chrono>
#include <cstdint>
#include <vector>

#include "agent/config/model.h"
#include "agent/field/bus/bus.h"
#include "agent/field/link/group_plans.h"
#include "agent/field/link/link_device.h"
#include "agent/field/link/link_state.h"
#include "agent/field/link/model_questions.h"
#include "agent/field/poll/poll_scheduler.h"
#include "agent/handover/telemetry.h"
#include "agent/steady_time.h"
#include "protocol/codec.h"

namespace fxagent {

class Poller final {
 public:
  /// `state` must outlive it.
  Poller(const LinkParts& link, LinkState& state);
  Poller(const Poller&) = delete;
  Poller& operator=(const Poller&) = delete;

  /// Adds the groups of the device, to it and to the scheduler. The first begins `after` the link
  /// may be opened, or after now; each other one when those before it should be finished. Returns
  /// the line time of one cycle of each.
  std::chrono::nanoseconds add_groups(LinkDevice& device, std::chrono::nanoseconds after);
  /// Applies interval, publish and max_silent of `groups`, by index in DeviceConfig::groups.
  void adjust_groups(LinkDevice& device, const std::vector<GroupConfig>& groups);
  /// Adds the background_question() of the device, if it has one.
  void add_question(LinkDevice& device);

  /// Carries out one step: an exchange, after the questions about the model if these are due. While
  /// the bus is closed, ends the cycle without an exchange.
  asio::awaitable<void> run(PollScheduler::PollStep step);

  /// Records that a command has written `span`, or may have; see PollCycle::overwritten().
  /// Afterwards no group of the device reports an older value.
  void overwritten(LinkDevice& device, const Span& span, const Bytes* image, BadReason why);
  enum class Origin : std::uint8_t { written, read_back };
  /// Publishes the value of a tag that a command has just changed, if its group is polled.
  void publish_written(LinkDevice& device, std::uint32_t tag, Value value, Origin origin);

  /// Returns the line time of the longest exchange that run() may send under the current plans.
  std::chrono::nanoseconds longest_poll() const { return plans_.longest_poll(); }

 private:
  SteadyTime first_time() const;
  /// Begins the cycle. False: it does not begin now, because the broker is behind or away.
  bool begin_cycle(LinkDevice& device, GroupPoll& group, const PollScheduler::PollStep& step);

  asio::awaitable<void> read_group(LinkDevice& device, GroupPoll& group,
                                   PollScheduler::PollStep step);
  /// The request of a step: the reads of its own exchange, or an outdated() read before it.
  struct Asked {
    ReadIndices reads;
    Request request;
    bool again = false;  ///< the step is offered once more
  };
  /// Records an invalid answer in the group's cycle, if it has closed the connection.
  void note_invalid(GroupPoll& group) const;
  void take_reading(LinkDevice& device, GroupPoll& group, const PollScheduler::PollStep& step,
                    const Asked& asked, Exchange exchange);
  enum class Refusal : std::uint8_t {
    ends_step,  ///< the cycle has ended or begins anew
    may_pass,   ///< the same reads may be offered again
    is_hole,    ///< a place is missing
    is_final,   ///< the reads are bad in this cycle
  };
  /// Handles the refusal of these reads.
  Refusal take_refusal(LinkDevice& device, GroupPoll& group, const PollScheduler::PollStep& step,
                       const Asked& asked, const Exchange& exchange);
  void end_step(LinkDevice& device, GroupPoll& group, const PollScheduler::PollStep& step);
  void fail_cycle(LinkDevice& device, GroupPoll& group, BadReason why);
  void finish_cycle(LinkDevice& device, GroupPoll& group);
  void publish(LinkDevice& device, Telemetry message);
  void note_load();

  const LinkParts link_;
  LinkState& state_;
  GroupPlans plans_;
  ModelQuestions questions_;
  bool overloaded_ = false;
};

}  // namespace fxagent
