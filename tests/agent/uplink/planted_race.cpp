// A deliberate data race in a callback that Paho calls: ThreadSanitizer has to report it. Races
// inside the library are suppressed (tests/support/tsan.supp); a suppression that is too broad
// would hide this race too. Runs only in the TSan build, where the report makes the test pass.
// Exits with status 0 if the race is not detected.
#include <chrono>
#include <cstdio>
#include <string>
#include <thread>

#include "agent/config/model.h"
#include "agent/uplink/paho/paho_broker.h"
#include "tests/agent/uplink/mosquitto.h"

namespace fxagent {
namespace {

using Clock = std::chrono::steady_clock;

int unguarded = 0;

/// On Paho's thread: a callback that forgot its lock.
void planted_race() { ++unguarded; }

/// Waits for this many events of a type; this thread increments the counter while it waits.
template <class Event>
bool await(PahoBroker& broker, int count) {
  const auto limit = Clock::now() + std::chrono::seconds(20);
  while (count > 0 && Clock::now() < limit) {
    ++unguarded;
    for (const BrokerEvent& event : broker.take_events())
      count -= std::holds_alternative<Event>(event) ? 1 : 0;
    std::this_thread::yield();
  }
  return count <= 0;
}

int run() {
  const test::Mosquitto mosquitto;
  MqttConfig config;
  config.servers = {mosquitto.url()};
  config.version = 5;
  config.client_id = "planted-race";
  PahoBroker broker(config, /*make_will=*/{}, planted_race, 1024);
  broker.connect(0, kReceiveMaximum);
  bool came = await<Connected>(broker, 1);
  constexpr int kPublications = 50;
  for (int id = 1; id <= kPublications; ++id) {
    broker.publish({.id = static_cast<std::uint64_t>(id), .topic = "a"});
  }
  came = came && await<Delivered>(broker, kPublications);
  if (!came) std::fprintf(stderr, "the broker did not answer\n");
  std::printf("%d\n", unguarded);
  return came ? 0 : 1;
}

}  // namespace
}  // namespace fxagent

int main() { return fxagent::run(); }
