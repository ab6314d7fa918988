#include "agent/uplink/status/status_line.h"

#include <gtest/gtest.h>

#include "agent/config/model.h"

#include "tests/support/says.h"

namespace fxagent {
namespace {

using State = DeviceStatus::State;

/// Two links with two devices each, all healthy.
struct Plant {
  Plant() {
    FieldHealth field;
    for (const std::string link : {"line1", "line2"}) {
      LinkConfig of;
      of.name = link;
      config.links.push_back(of);
      LinkHealth health;
      health.open = true;
      field.links.push_back(health);
    }
    for (const std::string device : {"press1", "press2", "oven", "pump"}) {
      DeviceConfig of;
      of.name = device;
      config.devices.push_back(std::move(of));
      status.devices.push_back(in(State::online));
    }
    status.field = std::make_shared<const FieldHealth>(std::move(field));
    status.broker.connected = true;
    status.commands[CommandStatus::succeeded] = 15;
    status.commands[CommandStatus::rejected] = 2;
    status.store_state = "disk";
  }
  static std::shared_ptr<const DeviceStatus> in(State state, std::string reason = {}) {
    DeviceStatus status;
    status.state = state;
    status.reason = std::move(reason);
    return std::make_shared<const DeviceStatus>(std::move(status));
  }
  void set_down(std::size_t link) {
    FieldHealth field = *status.field;
    field.links[link].open = false;
    status.field = std::make_shared<const FieldHealth>(std::move(field));
  }
  std::string line() const {
    AgentStatus made = status;
    made.config = std::make_shared<const Config>(config);
    return status_line(made);
  }

  Config config;
  AgentStatus status;
};

TEST(StatusLine, OfAnAgentThatIsWell) {
  EXPECT_EQ(Plant().line(),
            "links 2 of 2 up, devices 4 of 4 online; broker connected; 0 samples wait; "
            "17 commands");
}

TEST(StatusLine, NamesWhatIsDownAndWhy) {
  Plant plant;
  plant.set_down(1);
  plant.status.devices[2] = Plant::in(State::offline, "link_down");
  plant.status.devices[3] = Plant::in(State::degraded, "nak");
  plant.status.commands[CommandStatus::unknown_outcome] = 1;
  EXPECT_EQ(plant.line(),
            "links 1 of 2 up (line2 down), devices 2 of 4 online (oven offline: link_down, pump "
            "degraded: nak); broker connected; 0 samples wait; 18 commands, 1 UNKNOWN_OUTCOME");
}

TEST(StatusLine, OfManyNamesTheFirstThreeAreThere) {
  Plant plant;
  for (auto& device : plant.status.devices) device = Plant::in(State::offline, "timeout");
  test::expect_says(plant.line(),
                    "devices 0 of 4 online (press1 offline: timeout, press2 offline: "
                    "timeout, oven offline: timeout and 1 more);");
}

TEST(StatusLine, TellsWhyTheBrokerIsAwayAndSinceWhen) {
  Plant plant;
  plant.status.broker = {
      .server = "mqtt://127.0.0.1:1", .since_ms = 1790000000123, .why = "connection refused"};
  plant.status.samples.stored = 1;
  plant.status.samples.queued = 3;  // about to be sent
  test::expect_says(plant.line(),
                    "; broker not connected since 2026-09-21T14:13:20.123Z: connection "
                    "refused; 1 sample waits; ");
}

TEST(StatusLine, TellsWhatElseIsWrong) {
  Plant plant;
  plant.config.store.path = "/var/lib/fxagent";
  plant.status.store_state = "memory";
  plant.status.samples.stored = 120;
  plant.status.samples.dropped = 7;
  plant.status.conflict = "9f3c21aa";
  plant.status.broker.not_heard_why = "Not authorized";
  EXPECT_EQ(plant.line(),
            "another agent (boot 9f3c21aa) has the same id; links 2 of 2 up, devices 4 of 4 "
            "online; broker connected; 120 samples wait, 7 dropped, in memory: the disk refuses "
            "writes; 17 commands, none are received: Not authorized");
}

TEST(StatusLine, TellsThatTheFileIsWrongAndLeavesOutVacantPlaces) {
  Plant plant;
  plant.config.devices[1].name.clear();
  plant.status.config_status.last_reload = {.state = "rejected", .errors = {}, .errors_in_all = 2};
  EXPECT_EQ(plant.line(),
            "the config file has 2 errors and is not in force; links 2 of 2 up, devices 3 of 3 "
            "online; broker connected; 0 samples wait; 17 commands");
  plant.status.config_status.last_reload->state = "applied";
  EXPECT_TRUE(plant.line().starts_with("links 2 of 2 up")) << plant.line();
}

// The field has reported neither counters nor device states yet.
TEST(StatusLine, BeforeTheFieldHasSaidAnything) {
  Plant plant;
  plant.status.field = std::make_shared<const FieldHealth>();
  for (auto& device : plant.status.devices) device = nullptr;
  EXPECT_TRUE(
      plant.line().starts_with("links 0 of 2 up (line1 down, line2 down), devices 0 of 4 "
                               "online (press1 starting, "))
      << plant.line();
}

}  // namespace
}  // namespace fxagent
