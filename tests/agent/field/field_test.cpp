#include "agent/field/field.h"

#include <gtest/gtest.h>

#include <map>
#include <string>
#include <thread>
#include <vector>

#include "agent/commands/admission.h"
#include "agent/outbox.h"
#include "tests/agent/field/field_plant.h"

namespace fxagent::test {
namespace {

using std::chrono::milliseconds;
using Clock = std::chrono::steady_clock;

/// Two devices on two ports that are not there.
Config plant() {
  Config config;
  for (const char* name : {"line1", "line2"}) {
    SerialSettings settings;
    settings.path = "/dev/ttyNone0";
    config.links.push_back({name, settings, std::chrono::nanoseconds(0)});
    DeviceConfig device = port_device(name);
    device.link = static_cast<std::uint32_t>(config.links.size() - 1);
    device.tags.push_back(writable(tag(*device.codec, "setpoint", "D200")));
    config.devices.push_back(std::move(device));
  }
  return config;
}

AdmittedCommand write_setpoint(const Config& config, std::uint32_t device, std::string id) {
  Command command;
  command.device = device;
  command.id = std::move(id);
  command.op = Op::write;
  command.op_text = "write";
  command.targets.push_back({"setpoint", "", std::nullopt, number(50)});
  command.received = Clock::now();
  command.received_ms = 1790000000000;
  CommandAdmission admission(config.devices[device]);
  return std::get<AdmittedCommand>(
      admission.admit(std::move(command), config.devices[device].codec, 0, Clock::now()));
}

TEST(Field, EachCommandHasOneResultWhoeverSendsItAndWheneverItStops) {
  const Config config = plant();
  Outbox outbox(1000);
  Field field(config, outbox, {});
  field.start();
  constexpr int kEach = 200;
  std::vector<std::thread> senders;
  for (std::uint32_t device = 0; device < 2; ++device)
    senders.emplace_back([&, device] {
      for (int i = 0; i < kEach; ++i)
        field.submit(write_setpoint(config, device, "c" + std::to_string(i)));
    });
  for (std::thread& sender : senders) sender.join();
  field.stop();
  std::map<std::pair<std::uint32_t, std::string>, int> results;
  for (const CommandResult& result : outbox.take().results) {
    ++results[{result.device, result.id}];
    EXPECT_TRUE(result.reason == Reason::link_down || result.reason == Reason::shutting_down)
        << to_string(result.reason);
  }
  EXPECT_EQ(results.size(), 2U * kEach);
  for (const auto& [command, count] : results) EXPECT_EQ(count, 1) << command.second;
}

TEST(Field, StopLeavesItsCountersInTheOutbox) {
  const Config config = plant();
  Outbox outbox(1000);
  Field field(config, outbox, {});
  field.start();
  field.stop();
  const Outbox::Batch batch = outbox.take();
  ASSERT_TRUE(batch.health);
  EXPECT_EQ(batch.health->links.size(), 2U);
  EXPECT_EQ(batch.health->devices.size(), 2U);
  field.stop();  // once is enough, twice does no harm
}

TEST(Field, FieldThatNeverStartedMayGo) {
  const Config config = plant();
  Outbox outbox(1000);
  const Field field(config, outbox, {});
  EXPECT_EQ(outbox.take().states.size(), 2U) << "each device says that it is starting";
}

}  // namespace
}  // namespace fxagent::test
