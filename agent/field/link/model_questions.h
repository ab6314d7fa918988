// Asks the devices of one link for their model and RUN state. If a protocol has no RUN state, asks
// a device without tags for a sign of life instead. Field thread.
#pragma once

#include <asio/awaitable.hpp>
#include <cstdint>
#include <optional>
#include <string>

#include "agent/field/bus/bus.h"
#include "agent/field/link/group_plans.h"
#include "agent/field/link/link_device.h"
#include "agent/field/link/link_state.h"
#include "agent/field/poll/poll_scheduler.h"
#include "agent/handover/telemetry.h"
#include "protocol/codec.h"

namespace fxagent {

/// A device that is passed to a coroutine must outlive it.
class ModelQuestions final {
 public:
  /// `state` and `plans` must outlive it.
  ModelQuestions(const LinkParts& link, LinkState& state, GroupPlans& plans)
      : link_(link), state_(state), plans_(plans) {}

  /// Carries out one step of LinkDevice::question_group. The first asks the background_question(),
  /// after the questions about the model if that is unknown; each further one compares the model
  /// with the config. While the bus is closed, ends the cycle without an exchange.
  asio::awaitable<void> run(LinkDevice& device, PollScheduler::PollStep step);

  enum class Knowledge : std::uint8_t { known, plan_changed, unanswered };
  /// Asks for the model that the config leaves open. `failure` says why it went unanswered.
  asio::awaitable<Knowledge> ask_model(LinkDevice& device, BadReason& failure);

 private:
  /// Handles the exchange of the background_question(). True: the device has answered.
  bool take_answer(LinkDevice& device, const PollScheduler::PollStep& step,
                   const Exchange& exchange);
  /// Asks one question of PlcServices::identify() of a PLC with a configured model. After the last
  /// one, reports a difference.
  asio::awaitable<void> compare_model(LinkDevice& device, PollScheduler::PollStep step);
  /// Asks one question of PlcServices::identify(), and a second time if the refusal may pass.
  asio::awaitable<Exchange> ask_of_model(LinkDevice& device, const Request& question);
  /// Uses the codec of the model; nullopt: the answers do not identify it.
  Knowledge use_model(LinkDevice& device, const std::optional<std::string>& model);

  /// Reports the state after a question. Nothing else asks a device without polls, as that of a
  /// single command: if its model is not compared yet, it is asked again at once, twice at most,
  /// and is not reported as alive before.
  void end_question(LinkDevice& device, PollScheduler::GroupId group);

  const LinkParts link_;
  LinkState& state_;
  GroupPlans& plans_;
};

}  // namespace fxagent
