#include "agent/agent.h"

#include <algorithm>
#include <chrono>
#include <csignal>
#include <functional>
#include <memory>
#include <random>
#include <thread>
#include <utility>
#include <vector>

#include "agent/commands/commands.h"
#include "agent/commands/recovery.h"
#include "agent/commands/result.h"
#include "agent/field/field.h"
#include "agent/field/transport/host_lookup.h"
#include "agent/handover/command_message.h"
#include "agent/handover/outbox.h"
#include "agent/http/web_server.h"
#include "agent/log/log.h"
#include "agent/pair/pair_member.h"
#include "agent/process/service_manager.h"
#include "agent/process/service_reports.h"
#include "agent/process/this_process.h"
#include "agent/process/thread_progress.h"
#include "agent/recorder/flight_recorder.h"
#include "agent/reload.h"
#include "agent/store/guarded_store.h"
#include "agent/store/store.h"
#include "agent/text/text.h"
#include "agent/uplink/fenced_broker.h"
#include "agent/uplink/paho/paho_broker.h"
#include "agent/uplink/paho/socket_calls.h"
#include "agent/uplink/payload/json_payload.h"
#include "agent/uplink/profile/homeassistant_profile.h"
#include "agent/uplink/profile/json_profile.h"
#include "agent/uplink/profile/outlet.h"
#include "agent/uplink/profile/plain_profile.h"
#include "agent/uplink/profile/thingsboard_profile.h"
#include "agent/uplink/publisher.h"
#include "agent/uplink/sparkplug/sparkplug_profile.h"
#include "agent/uplink/sparkplug/typed_commands.h"
#include "agent/uplink/status/status_line.h"

namespace fxagent {
namespace {

// Far more than a healthy agent has waiting; the uplink empties the outbox at every step.
constexpr std::size_t kOutboxMessages = 65536;
// A status is made at once unless the uplink is blocked.
constexpr std::chrono::milliseconds kStatusWithin{500};
// Exceeded only while the reload reads a large config or an unresponsive file.
constexpr std::chrono::seconds kReloadEnds{2};
// Its own discovery messages come back to the profile `homeassistant`.
constexpr std::size_t kMaxDiscoveryBytes = std::size_t{4} << 20;
constexpr std::size_t kMostBacklogBytes = std::size_t{64} << 20;
constexpr const char* kLibraryThreads = "MQTTAsync_";  ///< begin of their names

/// Waits for the signal that ends the agent. Reports to the service manager until then.
int wait_for_stop(StopWatchdog& watchdog, ServiceReports& reports) {
  while (true) {
    if (const auto signal = watchdog.await_signal(reports.next())) return *signal;
    reports.keep(std::chrono::steady_clock::now());
  }
}

/// True while the threads of the MQTT library advance. Without them the agent neither sends nor
/// receives, and only a new process gets new threads.
bool advances(ThreadProgress& library) {
  return library.check(std::chrono::steady_clock::now(), paho_looks_up_host());
}

/// Starts the flight recorder; nullptr if the config has none.
std::unique_ptr<FlightRecorder> make_recorder(const Config& config) {
  if (!config.recorder) return nullptr;
  FlightRecorder::Settings settings;
  settings.directory = config.recorder->path;
  settings.most_files = config.recorder->files;
  settings.most_bytes = config.recorder->max_bytes;
  settings.agent = config.id;
  settings.version = FXAGENT_VERSION;
  return std::make_unique<FlightRecorder>(std::move(settings));
}

/// Returns the settings of the profile's session: those of its broker, with a client id of its own.
MqttConfig settings_of(const ProfileConfig& profile, const Config& config) {
  MqttConfig mqtt = broker_of(config, profile.broker);
  mqtt.client_id += "-" + std::string(kind_of(profile));
  return mqtt;
}

/// One profile beside the agent's own, with its part of the disk.
struct ProfileParts {
  std::unique_ptr<Store> store;
  std::unique_ptr<GuardedStore> guarded;
  std::unique_ptr<Profile> profile;
  std::unique_ptr<Broker> broker;
  std::unique_ptr<Outlet> outlet;
};

/// Makes the profile. `config` belongs to the uplink. `relay` gets its commands.
ProfileParts make_profile(const Config& config, const ProfileConfig& what,
                          const PublisherSettings& run, RelayCommand relay, Outbox& outbox,
                          std::uint32_t seed, const LinePermit* permit) {
  const auto wake = [&outbox] { outbox.notify(); };
  const BrokerConfig* broker = broker_named(config, what.broker);
  if (broker != nullptr && !broker->commands) relay = {};
  ProfileParts parts;
  auto new_id = [begin = run.boot + "-" + name_of(what) + "-", next = std::uint64_t{1}]() mutable {
    return begin + std::to_string(next++);
  };
  Outlet::Settings settings;
  switch (what.kind) {
    case ProfileConfig::Kind::json:
      parts.profile = std::make_unique<JsonProfile>(config, what, run.boot, run.version,
                                                    utc_now_ms(), std::move(relay));
      break;
    case ProfileConfig::Kind::plain:
      parts.profile =
          std::make_unique<PlainProfile>(config, what, std::move(relay), std::move(new_id));
      break;
    case ProfileConfig::Kind::homeassistant:
      parts.profile = std::make_unique<HomeAssistantProfile>(
          config, what, run.version, relay ? HearsCommands::yes : HearsCommands::no);
      break;
    case ProfileConfig::Kind::thingsboard:
      parts.profile =
          std::make_unique<ThingsBoardProfile>(config, what, std::move(relay), std::move(new_id));
      break;
    case ProfileConfig::Kind::sparkplug:
      parts.profile = std::make_unique<SparkplugProfile>(config, what, std::move(relay),
                                                         std::move(new_id), utc_now_ms);
      settings.marker_topic = config.base_topic() + "/sparkplug";
      break;
    case ProfileConfig::Kind::sparkplug_commands:
      parts.profile =
          std::make_unique<TypedCommandsProfile>(config, what, std::move(relay), utc_now_ms);
      break;
  }
  if (!config.store.path.empty() && parts.profile->wants_samples()) {
    StoreConfig own = config.store;
    own.path += "/" + name_of(what);
    own.keeps_commands = false;
    parts.store = std::make_unique<Store>(own, utc_now_ms());
    parts.guarded = std::make_unique<GuardedStore>(*parts.store, wake);
  }
  settings.name = name_of(what);
  settings.mqtt_of = [what](const Config& next) { return settings_of(what, next); };
  settings.mqtt = settings.mqtt_of(config);
  settings.boot = run.boot;
  settings.backlog_bytes = run.backlog_bytes;
  settings.jitter_seed = seed;
  const bool is_discovery = what.kind == ProfileConfig::Kind::homeassistant;
  parts.broker =
      fenced(std::make_unique<PahoBroker>(
                 settings.mqtt, [profile = parts.profile.get()] { return profile->last_will(); },
                 wake, is_discovery ? kMaxDiscoveryBytes : kMaxMessageBytes),
             permit);
  parts.outlet = std::make_unique<Outlet>(config, std::move(settings), *parts.profile,
                                          *parts.broker, utc_now_ms, parts.guarded.get());
  return parts;
}

/// Waits on standby until this gateway of a pair is to run the agent. A stop signal ends the
/// process meanwhile. Calls `hangup` at each SIGHUP.
PairMember::Claimed stand_by(PairMember& pair, const std::function<void()>& hangup) {
  service_manager::notify_ready();
  service_manager::notify_status("standby of its pair");
  ThreadProgress library(kLibraryThreads, "pair");
  return pair.await_claim([&] {
    if (advances(library) && service_manager::watchdog_interval()) service_manager::notify_alive();
    if (hangup_within(std::chrono::seconds(0))) hangup();
  });
}

}  // namespace

// The uplink owns `config` from here on; a reload overwrites it with the next one.
void run_agent(Config config, const std::string& path, RemoteConfig& remote, StopWatchdog& watchdog,
               const std::vector<std::uint32_t>& traced) {
  raise_file_limit(kFilesNotForLinks);
  check_file_limit(files_needed(config));
  const auto served_at = config.http;
  auto in_force = std::make_shared<const Config>(config);
  std::random_device random;
  PublisherSettings settings;
  settings.boot = random_digits();
  settings.version = FXAGENT_VERSION;
  settings.jitter_seed = random();
  settings.backlog_bytes =
      static_cast<std::size_t>(std::min<std::uint64_t>(config.store.max_bytes, kMostBacklogBytes));

  Heartbeats signs(config.pair.has_value());
  const auto pair = config.pair ? std::make_unique<PairMember>(config, settings.boot) : nullptr;
  const LinePermit* const permit = pair ? &pair->permit() : nullptr;
  auto begin = Reload::Begin::waiting;
  const auto hangup = [&] {
    check_local(config, path, remote);
    begin = Reload::Begin::with_reload;
  };
  PairMember::Claimed claimed = pair ? stand_by(*pair, hangup) : PairMember::Claimed{};
  settings.first_seq = claimed.floor;
  if (pair)
    settings.is_ours = [member = pair.get()](const std::string& boot) {
      return member->knows(boot);
    };
  const auto store =
      config.store.path.empty() ? nullptr : std::make_unique<Store>(config.store, utc_now_ms());
  Outbox outbox(kOutboxMessages);
  const auto guarded =
      store ? std::make_unique<GuardedStore>(*store, [&outbox] { outbox.notify(); }) : nullptr;
  const auto recorder = make_recorder(config);
  std::vector<std::uint64_t> numbers = first_numbers(config, store.get(), utc_now_ms());
  for (std::uint64_t& number : numbers) number = std::max(number, claimed.floor);
  Field field(config, outbox, numbers, Polling::on, recorder.get(), permit);
  const auto submit = [&field](AdmittedCommand admitted) { field.submit(std::move(admitted)); };
  Commands commands(
      config,
      [&config, &pair, submit](AdmittedCommand admitted) {
        if (!pair) return submit(std::move(admitted));
        const std::string& device = std::as_const(config).devices.at(admitted.command.device).name;
        pair->announcements().add(std::move(admitted), device, submit);
      },
      guarded ? &guarded->journal() : nullptr,
      [&field, &outbox](const std::string& link, std::chrono::minutes time, const std::string& text,
                        std::function<void(Reason)> done) {
        field.yield(link, time, text, [&outbox, done = std::move(done)](Reason why) {
          outbox.post([done, why](SteadyTime) { done(why); });
        });
      });
  if (guarded) {
    const auto now = std::chrono::steady_clock::now();
    if (pair) take_over(claimed.unwritten, *store);
    const auto newer = std::exchange(claimed.unwritten, {});
    commands.restore(recover(config, guarded->journal(), utc_now_ms(), now, newer), now,
                     utc_now_ms());
  }
  JsonPayload payload(config, settings.boot, settings.version);
  const auto broker = fenced(
      std::make_unique<PahoBroker>(
          config.mqtt, [&payload] { return payload.last_will(); }, [&outbox] { outbox.notify(); }),
      permit);
  settings.number_above = [&field](std::vector<std::uint64_t> last_seq) {
    field.number_above(std::move(last_seq));
  };
  settings.ask_counters = [&field] { field.report(); };
  Publisher publisher(config, settings, payload, outbox, *broker, commands, utc_now_ms,
                      guarded.get());

  std::vector<ProfileParts> profiles;
  for (const ProfileConfig& what : std::as_const(config).profiles) {
    const auto relay = [&publisher](RelayedCommand command) {
      publisher.take_relayed(std::move(command), std::chrono::steady_clock::now());
    };
    profiles.push_back(make_profile(config, what, settings, relay, outbox, random(), permit));
    publisher.add(*profiles.back().outlet);
  }
  // Each profile commits a sample on its own. After a kill between two commits, only the store of a
  // profile has the newest number, and it must not be used again. With `sync: offline` the agent's
  // own store has reserved it.
  if (config.store.sync_always)
    for (const ProfileParts& parts : profiles)
      if (parts.store) field.number_above(first_numbers(config, parts.store.get(), 0));

  log::info("agent", {{"state", "starting"},
                      {"id", config.id},
                      {"boot", settings.boot},
                      {"version", settings.version},
                      {"links", std::to_string(config.links.size())},
                      {"devices", std::to_string(config.devices.size())}});
  watchdog.begin("the start");
  field.trace(traced);
  field.switch_traces_at(SIGUSR1);
  if (recorder) field.call_at(SIGUSR2, [&recorder] { recorder->asked(); });
  remote.begin();
  field.start();
  if (pair)
    pair->agent_began(
        {.highest_seq = [&outbox] { return outbox.highest_seq(); },
         .goes_on = [&signs] { signs.pair_went_on(); },
         .is_stopping = [&watchdog] { return watchdog.has_signal(); },
         .take_unanswered =
             [&](JournalEntry left, const std::string& topic) {
               const auto reply = [&pair](JournalEntry known) { pair->reply(std::move(known)); };
               outbox.post(
                   [&publisher, command = Publisher::Unanswered{std::move(left), topic, reply}](
                       SteadyTime) mutable { publisher.take_unanswered(std::move(command)); });
             }});
  const auto take_back = [&](const std::vector<std::uint32_t>& ending, std::function<void()> done) {
    if (!pair) return done();
    pair->announcements().take_back(
        ending, [&outbox, done = std::move(done)](std::vector<AdmittedCommand> waiting) {
          for (const AdmittedCommand& each : waiting)
            outbox.push(not_sent(each, Reason::reloading));
          done();
        });
  };
  Reload reload(path, remote, std::move(in_force), field, outbox, publisher, take_back, begin);
  std::jthread uplink([&](std::stop_token stop) {
    ThreadProgress library(kLibraryThreads, "uplink");
    run_uplink(publisher, outbox, stop, [&] {
      if (advances(library)) signs.uplink_went_on();
    });
  });
  const auto place = [&](RelayedCommand command) {
    outbox.post([&publisher, command = std::move(command)](SteadyTime now) mutable {
      publisher.take_relayed(std::move(command), now);
    });
  };
  auto metrics =
      served_at ? std::make_unique<WebServer>(*served_at, publisher.board(), place, recorder.get())
                : nullptr;
  service_manager::notify_ready();

  const auto ask = [&] {
    field.post([&signs] { signs.field_went_on(); });
    outbox.notify();
  };
  const auto current_status = [&] {
    const auto status = publisher.board().read(std::chrono::steady_clock::now(), kStatusWithin);
    return status ? status_line(*status) : std::string();
  };
  ServiceReports reports(signs, {ask, current_status}, std::chrono::steady_clock::now());
  const int signal = wait_for_stop(watchdog, reports);
  watchdog.stage("the log: its reader does not read");
  service_manager::notify_stopping();
  service_manager::notify_status("stopping");
  log::info("agent", {{"state", "stopping"}, {"signal", std::to_string(signal)}});
  reload.stop();
  watchdog.stage("metrics");
  metrics.reset();
  if (pair) {
    outbox.refuse_commands();
    pair->announcements().release();
  }
  watchdog.stage("links", [&field] { return field.unfinished(); });
  field.stop();
  watchdog.stage("the uplink: the store's disk or the broker");
  uplink.request_stop();
  outbox.notify();
  uplink.join();
  if (pair) pair->leave();
  watchdog.stage("the reload: a config file or the disk");
  reload.wait_for_end(kReloadEnds);
  watchdog.stage("the log: its reader does not read");
  log::info("agent", {{"state", "stopped"}});
  service_manager::notify_status("stopped");
  // A name lookup, a driver or the MQTT library may take time to let go.
  watchdog.nothing_left_to_lose();
}

}  // namespace fxagent
