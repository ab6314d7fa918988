#include "agent/field/field.h"

#include <gtest/gtest.h>

#include <future>
#include <random>
#include <set>
#include <stdexcept>
#include <thread>

#include "agent/commands/admission.h"
#include "agent/handover/outbox.h"
#include "tests/agent/field/field_plant.h"
#include "tests/protocol/gathering_codec.h"
#include "tests/support/scratch.h"

namespace fxagent::test {
namespace {

using std::chrono::milliseconds;
using Clock = std::chrono::steady_clock;

/// Two devices on two ports that do not exist.
Config plant() {
  Config config;
  for (const char* name : {"line1", "line2"}) {
    config.links.push_back(
        {name, SerialSettings{.path = "/dev/ttyNone0"}, std::chrono::nanoseconds(0)});
    DeviceConfig device = port_device(name);
    device.link = static_cast<std::uint32_t>(config.links.size() - 1);
    device.tags.push_back(writable(tag(*device.codec, "setpoint", "D200")));
    config.devices.push_back(std::move(device));
  }
  return config;
}

AdmittedCommand write_setpoint(const Config& config, std::uint32_t device, std::string id) {
  Command command =
      command_of(std::move(id), Op::write, {{"setpoint", "", std::nullopt, number(50)}});
  command.device = device;
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
  field.stop();  // calling it twice is harmless
}

TEST(Field, FieldThatNeverStartedMayGo) {
  const Config config = plant();
  Outbox outbox(1000);
  const Field field(config, outbox, {});
  EXPECT_EQ(outbox.take().states.size(), 2U) << "each device says that it is starting";
}

/// A field and the uplink's side of a change. Its ports do not exist, so every poll gives a bad
/// sample.
struct FieldChangeTest : ::testing::Test {
  FieldChangeTest() {
    now = plant();
    for (DeviceConfig& device : now.devices) {
      device.groups[0].interval = milliseconds(5);
      device.groups[0].max_silent = std::chrono::seconds(0);  // reports every attempt
    }
    field = std::make_unique<Field>(now, outbox, std::vector<std::uint64_t>{100, 100});
    field->start();
  }
  void take() {
    Outbox::Batch batch = outbox.take();
    for (const Telemetry& message : batch.telemetry)
      seqs[std::as_const(now).devices.at(message.device).name].push_back(message.seq);
    for (const CommandResult& result : batch.results) ++results[result.id];
    for (const DeviceStatus& status : batch.states) begun.insert(status.device);
    if (batch.health) {
      health = *batch.health;
      std::uint64_t reported = health.ended_collected - health.ended_suppressed;
      for (const DeviceHealth& device : health.devices)
        reported += device.collected - device.suppressed;
      EXPECT_EQ(reported, batch.pushed_at_health);
    }
    for (const Outbox::Call& call : batch.calls) call(Clock::now());
  }
  void wait(const std::function<bool()>& reached) {
    const auto give_up = Clock::now() + std::chrono::seconds(20);
    while (!reached() && Clock::now() < give_up) {
      outbox.wait_until(Clock::now() + milliseconds(20));
      take();
    }
    EXPECT_TRUE(reached());
  }
  void send(std::uint32_t device) {
    const std::string id = "c" + std::to_string(sent++);
    field->submit(write_setpoint(now, device, id));
  }
  void change_to(Config wanted) {
    const auto change =
        std::make_shared<const ConfigChange>(change_between(now, std::move(wanted)));
    bool done = false;
    const auto call = [&] { outbox.post([&](SteadyTime) { done = true; }); };
    for (std::uint32_t i = 0; i < now.devices.size(); ++i)
      if (!std::as_const(now).devices[i].is_vacant()) send(i);
    field->end(change, call);
    wait([&] { return done; });
    now = change->config;
    done = false;
    // Without a store, sequence numbers start at the clock. This has no effect on existing devices.
    const std::vector<std::uint64_t> clock(now.devices.size(), 1790000000000);
    field->begin(change, clock, call);
    for (std::uint32_t i = 0; i < now.devices.size(); ++i)
      if (!std::as_const(now).devices[i].is_vacant()) send(i);
    wait([&] { return done; });
  }
  void expect_no_gaps() {
    for (const auto& [name, list] : seqs)
      for (std::size_t i = 1; i < list.size(); ++i) ASSERT_EQ(list[i], list[i - 1] + 1) << name;
  }
  void stop() {
    field->stop();
    take();
    EXPECT_EQ(results.size(), static_cast<std::size_t>(sent));
    for (const auto& [id, count] : results) EXPECT_EQ(count, 1) << id;
    expect_no_gaps();
  }

  Config now;
  Outbox outbox{100000};
  std::unique_ptr<Field> field;
  std::map<std::string, std::vector<std::uint64_t>> seqs;
  std::map<std::string, int> results;
  std::set<std::uint32_t> begun;  ///< devices with a state
  FieldHealth health;
  int sent = 0;
};

TEST_F(FieldChangeTest, LinkBeginsAnewAndItsDeviceGoesOnCounting) {
  wait([&] { return seqs["line1"].size() > 3 && seqs["line2"].size() > 3; });
  Config wanted = now;
  std::get<SerialSettings>(wanted.links[1].channel).path = "/dev/ttyNone1";
  change_to(std::move(wanted));
  const std::size_t so_far = seqs["line2"].size();
  wait([&] { return seqs["line2"].size() > so_far + 3; });
  EXPECT_GT(health.ended_collected, 0U);
  stop();
}

TEST_F(FieldChangeTest, DeviceOfAnotherIntervalIsPolledByIt) {
  Config wanted = now;
  for (DeviceConfig& device : wanted.devices) device.groups[0].interval = std::chrono::hours(1);
  change_to(wanted);
  wanted.devices[1].groups[0].interval = milliseconds(5);
  const std::size_t so_far = seqs["line2"].size();
  change_to(std::move(wanted));
  EXPECT_EQ(health.ended_collected, 0U) << "no device has ended";
  wait([&] { return seqs["line2"].size() > so_far + 3; });
  stop();
}

TEST_F(FieldChangeTest, DeviceThatWasTakenOutGoesOnCountingWhenItComesBack) {
  wait([&] { return seqs["line2"].size() > 3; });
  const Config both = now;
  Config one = now;
  one.devices.pop_back();
  one.links.pop_back();
  change_to(std::move(one));
  EXPECT_EQ(now.devices.size(), 1U);
  const std::size_t so_far = seqs["line2"].size();
  // Once or twice: a silent device is polled less and less often.
  wait([&, others = seqs["line1"].size()] { return seqs["line1"].size() > others + 1; });
  EXPECT_EQ(seqs["line2"].size(), so_far);
  change_to(both);
  wait([&] { return seqs["line2"].size() > so_far + 3; });
  stop();
}

TEST_F(FieldChangeTest, ManyChangesInQuickSuccessionLoseNothing) {
  std::mt19937 random(3);
  const Config both = now;
  for (int i = 0; i < 60; ++i) {
    Config wanted = both;
    const auto which = random() % 2;
    switch (random() % 5) {
      case 0:
        std::get<SerialSettings>(wanted.links[which].channel).path =
            "/dev/ttyNone" + std::to_string(random() % 3);
        break;
      case 1:
        wanted.devices[which].timeout = milliseconds(500 + random() % 3);
        break;
      case 2:
        wanted.devices.pop_back();
        break;
      case 3:
        wanted.devices[which].groups[0].interval = milliseconds(1 + random() % 5);
        break;
      default:
        wanted.devices.push_back(wanted.devices[0]);
        wanted.devices.back().name = "third";
    }
    change_to(std::move(wanted));
  }
  stop();
}

/// A codec that fails while a link begins, as a system without memory does.
class FailingCodec final : public GatheringCodec {
 public:
  const PlcServices* plc() const override { throw std::runtime_error("no memory"); }
};

TEST_F(FieldChangeTest, DeviceOfALinkThatDidNotBeginMayBeRemoved) {
  const auto change_without_commands = [&](Config wanted) {
    const auto change =
        std::make_shared<const ConfigChange>(change_between(now, std::move(wanted)));
    bool done = false;
    const auto call = [&] { outbox.post([&](SteadyTime) { done = true; }); };
    field->end(change, call);
    wait([&] { return done; });
    now = change->config;
    done = false;
    field->begin(change, std::vector<std::uint64_t>(now.devices.size(), 100), call);
    wait([&] { return done; });
  };
  Config more = now;
  more.links.push_back({"line3", SerialSettings{.path = "/dev/ttyNone3"}, {}});
  for (const char* name : {"third", "fourth"}) {
    more.devices.push_back(port_device(name, std::make_shared<FailingCodec>()));
    more.devices.back().link = 2;
  }
  more.devices.push_back(port_device("fifth"));
  more.devices.back().link = 2;
  change_without_commands(more);
  EXPECT_TRUE(begun.contains(1));
  EXPECT_FALSE(begun.contains(4)) << "all devices of a link begin, or none";
  more.devices.back().retries = 5;
  change_without_commands(more);
  EXPECT_FALSE(begun.contains(4)) << "also after a later change";
  more.devices.pop_back();
  change_without_commands(more);
  more.devices.pop_back();
  more.devices.pop_back();
  more.devices.push_back(port_device("sixth"));
  more.devices.back().link = 2;
  more.links.back().channel = SerialSettings{.path = "/dev/ttyNone4"};
  change_without_commands(std::move(more));
  EXPECT_TRUE(begun.contains(2)) << "the link begins anew";
  const std::size_t so_far = seqs["line1"].size();
  wait([&] { return seqs["line1"].size() > so_far; });
  stop();
}

TEST_F(FieldChangeTest, RingOfANewLinkHasItsShareAmongTheLinksInForce) {
  const test::Scratch scratch;
  FlightRecorder recorder({.directory = scratch.path("recordings"), .most_files = 1});
  now.recorder = RecorderConfig{};
  Outbox own{1000};
  Field recorded(now, own, {100, 100}, Polling::on, &recorder);
  recorded.start();
  Config more = now;
  for (int i = 0; i < 100; ++i)
    more.links.push_back({"l" + std::to_string(i), SerialSettings{.path = "/dev/ttyNone9"}, {}});
  const auto change = std::make_shared<const ConfigChange>(change_between(now, more));
  std::promise<void> ended;
  recorded.end(change, [&] { ended.set_value(); });
  ended.get_future().wait();
  std::promise<void> begun_all;
  recorded.begin(change, {100, 100}, [&] { begun_all.set_value(); });
  begun_all.get_future().wait();
  EXPECT_EQ(recorder.ring_of("line1")->bytes(), ring_bytes(*now.recorder, 2));
  EXPECT_EQ(recorder.ring_of("l99")->bytes(), ring_bytes(*now.recorder, 102));
  recorded.stop();
}

TEST_F(FieldChangeTest, StopInTheMiddleOfAChangeLosesNothing) {
  Config wanted = now;
  std::get<SerialSettings>(wanted.links[1].channel).path = "/dev/ttyNone1";
  const auto change = std::make_shared<const ConfigChange>(change_between(now, std::move(wanted)));
  for (int i = 0; i < 20; ++i) send(static_cast<std::uint32_t>(i % 2));
  field->end(change, [] {});
  for (int i = 0; i < 20; ++i) send(static_cast<std::uint32_t>(i % 2));
  stop();
}

}  // namespace
}  // namespace fxagent::test
