#include "tests/agent/path/agent_life.h"

#include <gtest/gtest.h>

#include <asio/co_spawn.hpp>

#include "agent/commands/recovery.h"
#include "agent/commands/result.h"
#include "agent/failpoint.h"
#include "tests/support/clock_by_hand.h"

namespace fxagent::test {
namespace {

using std::chrono::milliseconds;
using Clock = std::chrono::steady_clock;

constexpr milliseconds kStep{10};
// Longer than any command takes including all timeouts: reaching it is a failure.
constexpr std::chrono::minutes kLongest{5};

Fate* g_fate = nullptr;  ///< of the current agent, for failpoint()

}  // namespace

std::int64_t path_utc_ms() {
  const auto since_epoch = std::chrono::system_clock::now().time_since_epoch();
  return std::chrono::duration_cast<milliseconds>(since_epoch).count();
}

AgentLife::AgentLife(const Config& config, LastingJournal& journal,
                     const std::vector<LedgerDevice*>& devices, Fate& fate, Polling polling,
                     Publish publish)
    : config_(config),
      fate_(fate),
      publish_(std::move(publish)),
      commands_(
          config,
          [this](AdmittedCommand admitted) {
            if (fate_.ends_here("before the field has it")) return;
            ++with_field_;
            const std::uint32_t link = config_.devices[admitted.command.device].link;
            workers_[link]->submit(std::move(admitted));
          },
          &journal) {
  g_fate = &fate;
  const auto by_link = devices_by_link(config);
  for (std::uint32_t link = 0; link < config.links.size(); ++link)
    workers_.push_back(std::make_unique<LinkWorker>(
        io_.get_executor(), config, link, by_link[link], outbox_,
        std::make_unique<FaultyLine>(io_.get_executor(), *devices[by_link[link][0]], fate),
        std::vector<std::uint64_t>{}, polling));
  commands_.restore(recover(config, journal, path_utc_ms(), Clock::now()), Clock::now(),
                    path_utc_ms());
  for (const auto& worker : workers_)
    asio::co_spawn(io_, worker->run(), [this](std::exception_ptr bug) {
      ++ended_;
      if (bug) std::rethrow_exception(bug);
    });
}

AgentLife::~AgentLife() {
  stop_links();
  for (int i = 0; !has_ended() && i < 1000; ++i) {
    advance_clock(kStep);
    poll_with_timers(io_);
  }
  EXPECT_TRUE(has_ended()) << "a link does not end";
  g_fate = nullptr;
}

void AgentLife::receive(const SentCommand& sent) {
  MessageProperties properties;
  properties.retained = sent.retained;
  properties.received = Clock::now();
  properties.received_ms = path_utc_ms();
  if (sent.message_expiry_s)
    properties.message_expiry = std::chrono::seconds(*sent.message_expiry_s);
  commands_.receive(config_.devices.at(sent.device).name, "command", sent.payload,
                    std::move(properties), Clock::now(), path_utc_ms());
}

void AgentLife::hand_over() {
  if (!fate_.has_ended()) commands_.hand_over(path_utc_ms());
}

void AgentLife::step(std::chrono::nanoseconds by) {
  advance_clock(by);
  poll_with_timers(io_);
  take_outbox();
  publish_results();
  take_acknowledgements();
}

void AgentLife::run_for(milliseconds duration) {
  const SteadyTime until = Clock::now() + duration;
  while (!fate_.has_ended() && Clock::now() < until)
    step(std::min<std::chrono::nanoseconds>(kStep, until - Clock::now()));
}

void AgentLife::run_until_idle() {
  const SteadyTime give_up = Clock::now() + kLongest;
  step(kStep);
  while (!fate_.has_ended() && (with_field_ > 0 || !in_flight_.empty()) && Clock::now() < give_up)
    step(kStep);
  EXPECT_LT(Clock::now(), give_up) << "a command has no result";
}

void AgentLife::stop(const std::function<void()>& meanwhile) {
  const bool admission_first = fate_.one_in(2);
  outbox_.refuse_commands();
  if (admission_first) commands_.close();
  stop_links();
  for (int i = 0; i < 600 && !fate_.has_ended() && !has_ended(); ++i) {
    step(kStep);
    if (i == 1) commands_.close();
    if (i < 5) meanwhile();
  }
  step(kStep);
}

void AgentLife::stop_links() {
  for (const auto& worker : workers_)
    if (!worker->has_ended()) worker->stop();
}

void AgentLife::take_outbox() {
  Outbox::Batch batch = outbox_.take();
  for (CommandResult& result : batch.results) {
    if (fate_.ends_here("before the result is taken")) return;
    --with_field_;
    commands_.finish(std::move(result), path_utc_ms());
  }
  for (const DeviceStatus& status : batch.states)
    if (status.codec) commands_.set_codec(status.device, status.codec, status.codec_of_plc);
}

void AgentLife::publish_results() {
  if (fate_.has_ended()) return;
  for (ResultMessage& message : commands_.results().take()) {
    if (fate_.ends_here("before the result is published")) return;
    publish_(commands_.device_named(message.device).value(),
             message.recorded ? message.text
                              : with_total(message.text, Clock::now() - message.received));
    if (fate_.ends_here("behind the published result")) return;
    if (fate_.between(1, 10) <= not_acknowledged) continue;
    in_flight_.push_back({std::move(message), Clock::now() + milliseconds(fate_.between(1, 200))});
  }
}

void AgentLife::take_acknowledgements() {
  std::erase_if(in_flight_, [this](const InFlight& each) {
    if (each.acknowledged_at > Clock::now() || fate_.has_ended()) return false;
    commands_.results().note_delivery(each.message, true, path_utc_ms());
    return true;
  });
}

}  // namespace fxagent::test

// Replaces the product's failpoint(), which does nothing.
void fxagent::failpoint(std::string_view name) noexcept {
  if (fxagent::test::g_fate != nullptr) fxagent::test::g_fate->ends_here(name);
}
