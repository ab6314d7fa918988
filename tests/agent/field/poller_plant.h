// The polls of one link, for tests that run every step.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <asio/io_context.hpp>

#include "agent/field/link/poller.h"
#include "tests/agent/field/field_plant.h"
#include "tests/agent/field/on_io.h"
#include "tests/support/scripted_transport.h"

namespace fxagent::test {

/// The polls of one link without its loop: a test runs every step. Nothing waits: if no poll is
/// due, the test advances the scheduler's time.
struct PollerTest : ::testing::Test {
  /// Call after the devices are configured and the script is written. Opens the bus.
  void start() {
    script();
    bus = std::make_unique<Bus>(io.get_executor(), std::move(transport), config.links[0].char_time);
    const LinkParts link{config.links[0], 0, *bus, scheduler, devices, outbox};
    state = std::make_unique<LinkState>(link, 1);
    poller = std::make_unique<Poller>(link, *state);
    std::chrono::nanoseconds after = state->begin(now, std::chrono::milliseconds(0));
    for (std::uint32_t i = 0; i < config.devices.size(); ++i) {
      devices.push_back(std::make_unique<LinkDevice>(config.devices.shared(i), i));
      devices[i]->id = scheduler.add_device(config.devices[i].retries + 1, {});
      after += poller->add_groups(*devices[i], after);
    }
    EXPECT_TRUE(run_on(io, bus->open()).has_value());
    state->opened();
  }
  ScriptedTransport& script() {
    if (wire == nullptr) {
      transport = std::make_unique<ScriptedTransport>(io.get_executor());
      wire = transport.get();
      wire->then([this](ByteView request) { return answer(request); });
    }
    return *wire;
  }
  virtual Bytes answer(ByteView request) = 0;

  void step() {
    PollScheduler::Job job = scheduler.next(now);
    if (job.kind == PollScheduler::Job::Kind::wait) {
      now = std::max(job.until, std::chrono::steady_clock::now());
      job = scheduler.next(now);
    }
    if (job.kind == PollScheduler::Job::Kind::poll) run_on(io, poller->run(job.poll));
    Outbox::Batch batch = outbox.take();
    for (auto& message : batch.telemetry) telemetry.push_back(std::move(message));
    for (auto& status : batch.states) newest[status.device] = status;
  }
  void steps_until(const std::function<bool()>& reached) {
    for (int i = 0; i < 1000 && !reached(); ++i) step();
    EXPECT_TRUE(reached());
  }
  static std::size_t bad(const Telemetry& message) {
    return static_cast<std::size_t>(
        std::count_if(message.readings.begin(), message.readings.end(),
                      [](const TagReading& reading) { return reading.bad.has_value(); }));
  }

  asio::io_context io;
  Config config;
  Outbox outbox{100000};
  PollScheduler scheduler;
  LinkDevices devices;
  std::unique_ptr<ScriptedTransport> transport;
  ScriptedTransport* wire = nullptr;
  std::unique_ptr<Bus> bus;
  std::unique_ptr<LinkState> state;
  std::unique_ptr<Poller> poller;
  SteadyTime now = std::chrono::steady_clock::now();
  std::vector<Telemetry> telemetry;
  std::map<std::uint32_t, DeviceStatus> newest;
};

}  // namespace fxagent::test
