// A status in which every number is different, for the plant of tests/agent/uplink/plant.h.
#pragma once

#include <memory>

#include "agent/handover/status.h"
#include "tests/agent/uplink/plant.h"

namespace fxagent::test {

inline constexpr SteadyTime kMade{std::chrono::hours(1)};

inline Config plant_with_store() {
  Config config = plant();
  config.store.path = "/var/lib/fxagent";
  return config;
}

inline LinkDurations made_up_durations() {
  using std::chrono::milliseconds;
  LinkDurations durations;
  for (const int ms : {1, 2, 30, 30}) durations.turnaround.add(milliseconds(ms));
  durations.lateness.add(milliseconds(0));
  durations.lateness.add(milliseconds(20'000));
  return durations;
}

inline FieldHealth made_up_field() {
  FieldHealth field;
  LinkHealth link;
  link.open = true;
  link.exchanges = 9642;
  link.timeouts = 3;
  link.naks = 4;
  link.bad_frames = 5;
  link.unexpected_bytes = 6;
  link.doubts = 7;
  link.busy_percent = 82.5;
  link.load_percent = 125;
  field.links = {link};
  field.devices.resize(2);
  field.devices[0].polls = 4821;
  field.devices[0].missed = 8;
  field.devices[1].polls = 11;
  field.durations = {made_up_durations()};
  return field;
}

inline AgentStatus made_up_status() {
  AgentStatus status;
  status.config = std::make_shared<const Config>(plant_with_store());
  status.ts_ms = 1790000060000;
  status.made_at = kMade;
  status.field_heard = kMade;
  status.boot = "9f3c21aa";
  status.version = "0.1.0";
  status.uptime = std::chrono::seconds(60);
  status.broker = {"mqtt://one:1883", true, true};
  status.samples = {4821, 17, 4100, 1, 2, 3, 732, 0, 738};
  status.profiles = {{"plain@cloud", "mqtt://two:1883", true, true, "", {}}};
  status.profiles[0].samples = {700, 0, 0, 4, 5, 6, 684, 1, 684};
  status.field = std::make_shared<const FieldHealth>(made_up_field());
  DeviceStatus online;
  online.state = DeviceStatus::State::online;
  status.devices = {std::make_shared<const DeviceStatus>(online),
                    std::make_shared<const DeviceStatus>(offline(1, "timeout"))};
  status.dropped = {0, 12};
  status.refused = {"", "0x97"};
  status.commands = {{CommandStatus::succeeded, 12}, {CommandStatus::unknown_outcome, 1}};
  status.command_durations.add(std::chrono::milliseconds(62));
  status.store_state = "disk";
  status.store_bytes = 40960;
  status.audit_records = 54;
  status.audit_head = "7d0f";
  status.hours_left = 812.5;
  status.clock_synchronised = true;
  status.rss_bytes = 10485760;
  return status;
}

/// The same without refused samples, which make an agent unready.
inline AgentStatus ready_status() {
  AgentStatus status = made_up_status();
  status.refused.clear();
  return status;
}

}  // namespace fxagent::test
