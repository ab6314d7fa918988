// Polls the devices of one link, exchange by exchange as the PollScheduler offers them: makes the
// plans of their groups, asks, takes what comes, and publishes what a group has to say at the end
// of its cycle. Asks for model and RUN state, too, and a device without tags whether it is
// there. Field thread.
#pragma once

#include <asio/awaitable.hpp>
#include <chrono>
#include <cstdint>
#include <string>
#include <vector>

#include "agent/config/config.h"
#include "agent/field/bus.h"
#include "agent/field/link_device.h"
#include "agent/field/link_state.h"
#include "agent/field/poll_scheduler.h"
#include "agent/messages.h"
#include "agent/outbox.h"
#include "protocol/codec.h"

namespace fxagent {

class Poller final {
 public:
  /// All arguments outlive it; `devices` may still be filled.
  Poller(const LinkConfig& link, Bus& bus, PollScheduler& scheduler, const LinkDevices& devices,
         LinkState& state, Outbox& outbox);
  Poller(const Poller&) = delete;
  Poller& operator=(const Poller&) = delete;

  /// Adds the device's groups, to it and to the scheduler. The first of them begins so long `after`
  /// the link may be opened, or after now; each other one when those before it should be through.
  /// Returns the line time that one cycle of each takes.
  std::chrono::nanoseconds add_groups(LinkDevice& device, std::chrono::nanoseconds after);
  /// Adds the background_question() of the device, where it has one.
  void add_question(LinkDevice& device);

  /// Carries out one step: an exchange, with the questions about the model before it where these
  /// are due. No exchange where the bus is closed; that ends the cycle.
  asio::awaitable<void> run(PollScheduler::PollStep step);
  /// Whether run() is under way.
  bool is_polling() const { return polling_; }

  /// A command has written `span`, or may have, as PollCycle::overwritten() has it: from now on no
  /// group of the device says an older value.
  void overwritten(LinkDevice& device, const Span& span, const Bytes* image, BadReason why);
  /// A command has just changed a tag. Publishes the value at once, where its group is polled.
  enum class Origin : std::uint8_t { written, read_back };
  void publish_written(LinkDevice& device, std::uint32_t tag, Value value, Origin origin);

  /// Line time of the longest exchange that run() may put on the wire by the plans of this moment.
  std::chrono::nanoseconds longest_poll() const;

 private:
  enum class Knowledge : std::uint8_t { known, plan_changed, unanswered };

  SteadyTime first_time() const;
  Plan plan_of(const LinkDevice& device, const GroupPoll& group,
               const std::vector<Point>& points) const;
  void make_plan(LinkDevice& device, GroupPoll& group);
  /// A new plan where the device was found to have holes, or other times, since the last one.
  void refresh_plan(LinkDevice& device, GroupPoll& group);
  /// Begins the cycle. False: it does not begin now, because the broker is behind.
  bool begin_cycle(LinkDevice& device, GroupPoll& group, const PollScheduler::PollStep& step);

  asio::awaitable<void> read_group(LinkDevice& device, GroupPoll& group,
                                   PollScheduler::PollStep step);
  asio::awaitable<void> ask_question(LinkDevice& device, PollScheduler::PollStep step);
  /// Asks one question of PlcServices::identify() of a PLC whose model the config names. Reports a
  /// difference after the last one.
  asio::awaitable<void> compare_model(LinkDevice& device, PollScheduler::PollStep step);
  /// One question of PlcServices::identify(), a second time where it is refused and may be
  /// answered.
  asio::awaitable<Exchange> ask_of_model(LinkDevice& device, const Request& question);
  /// Asks for the model, which the config leaves open. `failure` says why it went unanswered.
  asio::awaitable<Knowledge> ask_model(LinkDevice& device, BadReason& failure);
  /// What a step asks for: the reads of its own exchange, or one that was outdated() before it.
  struct Asked {
    ReadIndices reads;
    Request request;
    bool again = false;  ///< the step is offered once more
  };
  void take_reading(LinkDevice& device, GroupPoll& group, const PollScheduler::PollStep& step,
                    const Asked& asked, Exchange exchange);
  /// The device said no to these reads. True where the same are to be offered again.
  bool take_refusal(LinkDevice& device, GroupPoll& group, const PollScheduler::PollStep& step,
                    const Asked& asked, const Exchange& exchange, RefusalMeaning meaning);
  /// What was refused because something in it is missing is read in parts, by this cycle.
  void read_in_parts(LinkDevice& device, GroupPoll& group, const Asked& asked,
                     std::chrono::nanoseconds line_time);
  /// By a plan of their own under what is known by now. False: it keeps commands waiting.
  bool read_by_other_ways(LinkDevice& device, GroupPoll& group,
                          const std::vector<std::uint32_t>& points);
  void end_step(LinkDevice& device, GroupPoll& group, const PollScheduler::PollStep& step);
  /// Logs why the device or its gateway says no to everything, or to this: each reason once until
  /// the device is online.
  void tell_refusal(LinkDevice& device, const std::string& reason);
  void take_hole(LinkDevice& device, GroupPoll& group, const Asked& asked,
                 const Exchange& exchange);
  /// The device lacks a command for several places: all its groups get plans without it.
  void give_up_command(LinkDevice& device, std::uint8_t gather, const std::string& reason);
  /// Notes a Gather that went unanswered, where its parts can be read by themselves, too.
  void doubt_command(LinkDevice& device, const Request& request);
  /// The device has answered with data. True where all its groups have new plans for that.
  bool proves_command(LinkDevice& device, const Request& request);
  void fail_cycle(LinkDevice& device, GroupPoll& group, BadReason why);
  void finish_cycle(LinkDevice& device, GroupPoll& group);
  void publish(LinkDevice& device, Telemetry message);
  void note_load();

  const LinkConfig& link_;
  Bus& bus_;
  PollScheduler& scheduler_;
  const LinkDevices& devices_;
  LinkState& state_;
  Outbox& outbox_;
  bool polling_ = false;
  bool overloaded_ = false;
};

}  // namespace fxagent
