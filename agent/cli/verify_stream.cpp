#include "agent/cli/subcommands.h"

#include <algorithm>
#include <array>
#include <iostream>
#include <nlohmann/json.hpp>
#include <optional>
#include <string_view>
#include <utility>
#include <vector>

#include "agent/cli/exit_status.h"
#include "agent/cli/report/layout.h"
#include "agent/cli/report/stream_check.h"
#include "agent/cli/waiting_broker.h"
#include "agent/log/log.h"
#include "agent/text/json.h"
#include "agent/text/text.h"

namespace fxagent {
namespace {

using Clock = std::chrono::steady_clock;
using Seconds = std::chrono::duration<double>;

constexpr int kNotProvable = 3;       // nothing is known to be missing
constexpr int kNotListened = kWrong;  // no broker, or messages were dropped

constexpr std::chrono::milliseconds kPause{500};  // before the servers are tried again
// Longest time that the broker keeps messages for a listener that is away, or was killed.
constexpr std::chrono::seconds kMostKept{3600};
// A single row may exceed the target size of a history message. The broker gets the same limit.
constexpr std::size_t kMaxPayload = std::size_t{16} << 20;

/// Times without a connection after the first one.
struct Interruptions {
  std::uint64_t count = 0;
  std::uint64_t unkept = 0;  ///< the broker kept nothing for us in the meantime
  Seconds total{0};
};

/// The outcome of listening.
struct Reception {
  std::string fault;  ///< why it ended too early; empty if it did not
  std::string server;
  std::optional<Seconds> listened;  ///< nullopt: no subscription succeeded
  Interruptions interruptions;
  std::vector<DeviceStream> streams;
};

/// Connects, subscribes, listens and passes every message to the check. Connects again when the
/// connection is lost.
class Listener final {
 public:
  Listener(const MqttConfig& config, std::string base, StreamCheck check,
           std::chrono::seconds listen, const SettingNames& names)
      : servers_(config.servers),
        filters_{base + "/+/data/+/history", base + "/+/data/+"},
        listen_(listen),
        // A broker keeps no QoS 0 messages for a client that is away.
        keeps_messages_(config.qos > 0),
        check_(std::move(check)),
        connection_(config, kMaxPayload, names, std::min(listen + kBrokerPatience, kMostKept)) {}

  /// Runs until the time is up, a signal arrives, or no server can be listened to at the start.
  Reception run() {
    connect_to(0);
    while (!over_) {
      const bool goes_on = connection_.wait_until(std::min(deadline_, timer_));
      for (const BrokerEvent& event : connection_.broker().take_events())
        std::visit([this](const auto& e) { on(e); }, event);
      if (over_) break;
      if (!goes_on || Clock::now() >= deadline_) {
        if (!begun_) end("stopped before it could subscribe");
        if (lost_at_) end("no connection at the end: " + fault_);
        break;
      }
      if (Clock::now() >= timer_) timer_fired();
    }
    const SteadyTime ended = Clock::now();
    // The session outlives this program. Without subscriptions the broker queues nothing in it.
    for (const std::string& filter : filters_) connection_.broker().unsubscribe(filter);
    if (lost_at_) interruptions_.total += ended - *lost_at_;
    return {fault_, server(), begun_ ? std::optional<Seconds>(ended - *begun_) : std::nullopt,
            interruptions_, check_.report()};
  }

 private:
  const std::string& server() const { return servers_.at(server_); }
  void on(const Connected& event) {
    subscribed_ = 0;
    timer_ = Clock::now() + kBrokerPatience;
    if (lost_at_ && !(event.session_present && session_at_ == server_)) lose_session();
    subscribe();
  }
  void on(const ConnectFailed& event) { attempt_failed(event.text); }
  void on(const Subscribed& event) {
    if (!event.granted)
      return end(server() + ": the broker refuses " + event.filter + ": " + event.text);
    if (++subscribed_ < filters_.size()) return subscribe();
    fault_.clear();
    timer_ = SteadyTime::max();
    if (keeps_messages_) session_at_ = server_;
    if (lost_at_) interruptions_.total += Clock::now() - *std::exchange(lost_at_, std::nullopt);
    if (begun_) return;
    begun_ = Clock::now();
    deadline_ = *begun_ + listen_;
  }
  void on(const Message& event) { check_.take(event.topic, event.payload, event.retained); }
  void on(const Lost& event) {
    if (!begun_) return attempt_failed("lost: " + event.text);
    if (!lost_at_) {
      lost_at_ = Clock::now();
      session_lost_ = false;
      ++interruptions_.count;
    }
    fault_ = server() + ": lost: " + event.text;
    pause();
  }
  void on(const MessagesDropped& event) {
    end("this program was too slow: " + std::to_string(event.count) + " messages were dropped");
  }
  void on(const auto&) {}

  void connect_to(std::size_t server) {
    server_ = server;
    pauses_ = false;
    timer_ = Clock::now() + kBrokerPatience;
    connection_.broker().connect(server_, kReceiveMaximum);
  }
  /// Subscribes to history first: history that a live sample makes due must not be missed.
  void subscribe() {
    connection_.broker().subscribe({filters_.at(subscribed_), /*no_local=*/false});
  }
  void attempt_failed(const std::string& text) {
    if (begun_)
      fault_ = server() + ": " + text;
    else
      fault_ += (fault_.empty() ? "" : "; ") + server() + ": " + text;
    if (server_ + 1 < servers_.size()) return connect_to(server_ + 1);
    if (!begun_) return end(fault_);
    pause();
  }
  void pause() {
    pauses_ = true;
    timer_ = Clock::now() + kPause;
  }
  void timer_fired() {
    if (pauses_) return connect_to(0);
    // A connection given up here may have received messages that were not looked at.
    if (begun_) lose_session();
    attempt_failed("no answer");
  }
  /// Records that messages of this interruption may have gone unheard.
  void lose_session() {
    session_at_.reset();
    check_.interrupted();
    if (!std::exchange(session_lost_, true)) ++interruptions_.unkept;
  }
  void end(std::string fault) {
    over_ = true;
    fault_ = std::move(fault);
  }

  const std::vector<std::string> servers_;
  const std::array<std::string, 2> filters_;
  const std::chrono::seconds listen_;
  const bool keeps_messages_;
  StreamCheck check_;
  std::size_t server_ = 0;
  std::size_t subscribed_ = 0;
  SteadyTime deadline_ = SteadyTime::max();
  SteadyTime timer_{};   ///< of the attempt under way, or of the pause before the next one
  bool pauses_ = false;  ///< no attempt is under way
  /// Server that keeps our subscriptions while we are away, as far as we know.
  std::optional<std::size_t> session_at_;
  std::optional<SteadyTime> lost_at_;  ///< of the interruption under way
  bool session_lost_ = false;          ///< in this interruption
  Interruptions interruptions_;
  std::optional<SteadyTime> begun_;
  bool over_ = false;
  std::string fault_;
  WaitingBroker connection_;  // last, so that it is destroyed first
};

/// Returns the config with its own client id, which two clients of a broker cannot share, and with
/// the credentials given on the command line.
MqttConfig connection_of(const MqttConfig& config, const VerifyStream& what) {
  MqttConfig own = config;
  own.client_id += "-verify-" + random_digits();
  if (what.username.empty() && what.password_file.empty() && what.password_env.empty()) return own;
  if (!what.username.empty()) own.username = what.username;
  own.password.clear();
  own.password_file = what.password_file;
  own.password_env = what.password_env;
  return own;
}

/// Returns the names of the config, and the options for user and password if they were given.
SettingNames names_for(const VerifyStream& what) {
  SettingNames names;
  names.access =
      "its access rules do not allow this for this user; fxagent acl CONFIG --viewer NAME prints "
      "the rules of a user who may: name it with --username";
  if (!what.username.empty()) names.user = "--username";
  return names;
}

std::vector<std::string> sending_devices(const Config& config) {
  std::vector<std::string> names;
  for (const DeviceConfig& device : config.devices)
    if (!device.tags.empty()) names.push_back(device.name);
  return names;
}

// ---- the report ---------------------------------------------------------------------------------

using OrderedJson = nlohmann::ordered_json;

OrderedJson json_of(const NumberRanges& ranges) {
  OrderedJson out;
  out["numbers"] = ranges.numbers;
  out["ranges"] = ranges.ranges;
  auto& first = out["first_ranges"] = OrderedJson::array();
  for (const NumberRange& range : ranges.listed) first.push_back({range.first, range.last});
  return out;
}

OrderedJson json_of(const DeviceStream& stream) {
  OrderedJson out;
  out["device"] = stream.device;
  out["ok"] = stream.is_whole();
  out["expected"] = stream.expected;
  out["samples"] = stream.live + stream.history;
  out["live"] = stream.live;
  out["history"] = stream.history;
  out["distinct"] = stream.distinct;
  out["first"] = stream.seen ? OrderedJson(stream.seen->first) : OrderedJson();
  out["last"] = stream.seen ? OrderedJson(stream.seen->last) : OrderedJson();
  out["missing"] = json_of(stream.missing);
  out["unprovable"] = json_of(stream.unprovable);
  out["skipped"] = json_of(stream.skipped);
  out["repeated"] = stream.repeated;
  out["differing"] = stream.differing;
  out["disordered"] = stream.disordered;
  out["ts_backward"] = stream.ts_backward;
  out["malformed"] = stream.malformed;
  if (stream.malformed > 0) out["malformed_why"] = stream.malformed_why;
  out["boots"] = stream.boots;
  return out;
}

std::string text_of(const NumberRanges& ranges) {
  std::string text;
  for (const NumberRange& range : ranges.listed) {
    text += (text.empty() ? "" : ", ") + std::to_string(range.first);
    if (range.last != range.first) text += "-" + std::to_string(range.last);
  }
  const std::uint64_t more = ranges.ranges - ranges.listed.size();
  return more == 0 ? text : text + " and " + std::to_string(more) + " more ranges";
}

void print(const DeviceStream& stream) {
  const auto line = [](const std::string& text) { std::cout << "  " << text << '\n'; };
  std::cout << escaped(stream.device, Escape::terminal) << ": ";
  if (!stream.decided)
    std::cout << (stream.history == 0 ? "no sample was received" : "no live sample was received");
  else if (stream.missing.numbers == 0)
    std::cout << (stream.unprovable.numbers > 0 ? "nothing is known to be missing"
                                                : "nothing is missing");
  else
    std::cout << stream.missing.numbers << " missing: " << text_of(stream.missing);
  std::cout << '\n';
  if (stream.seen)
    line(std::to_string(stream.live) + " live and " + std::to_string(stream.history) +
         " history samples, numbers " + std::to_string(stream.seen->first) + " to " +
         std::to_string(stream.seen->last));
  if (stream.unprovable.numbers > 0)
    line("not provable: sent during an interruption, skipped by a new boot, or lost: " +
         std::to_string(stream.unprovable.numbers) + ": " + text_of(stream.unprovable));
  if (stream.skipped.numbers > 0)
    line("skipped by a new boot: " + std::to_string(stream.skipped.numbers) + ": " +
         text_of(stream.skipped));
  if (stream.repeated > 0)
    line("repeated: " + std::to_string(stream.repeated) +
         (stream.differing == 0
              ? ", each time the same sample"
              : ", " + std::to_string(stream.differing) + " of them with a DIFFERENT sample"));
  if (stream.disordered > 0)
    line("after a higher number on its topic: " + std::to_string(stream.disordered));
  if (stream.ts_backward > 0) line("ts goes backward: " + std::to_string(stream.ts_backward));
  if (stream.malformed > 0)
    line("malformed: " + std::to_string(stream.malformed) +
         ", the first: " + escaped(stream.malformed_why, Escape::terminal));
  if (stream.boots.size() > 1) {
    std::string boots;
    for (const std::string& boot : stream.boots)
      boots += (boots.empty() ? "" : ", ") + escaped(boot, Escape::terminal);
    line("boots: " + boots);
  }
}

bool has_samples(const std::vector<DeviceStream>& streams) {
  return std::ranges::any_of(streams,
                             [](const DeviceStream& stream) { return stream.seen.has_value(); });
}

/// Status of what the streams prove.
int status_of(const std::vector<DeviceStream>& streams) {
  if (!has_samples(streams) || !std::ranges::all_of(streams, &DeviceStream::is_sound))
    return kFailed;
  return std::ranges::all_of(streams, &DeviceStream::is_whole) ? kDone : kNotProvable;
}

void print_json(const Reception& reception, const std::string& base) {
  OrderedJson out;
  out["ok"] = reception.fault.empty() && status_of(reception.streams) == kDone;
  out["error"] = or_null(reception.fault);
  out["base"] = base;
  out["server"] = reception.server;
  out["seconds"] = tenth(reception.listened->count());
  const Interruptions& away = reception.interruptions;
  out["interruptions"] = {
      {"count", away.count}, {"seconds", tenth(away.total.count())}, {"unkept", away.unkept}};
  auto& devices = out["devices"] = OrderedJson::array();
  for (const DeviceStream& stream : reception.streams) devices.push_back(json_of(stream));
  std::cout << dumped(out) << '\n';
}

/// Returns the probable cause that the broker kept no messages.
std::string_view why_unkept(const MqttConfig& mqtt) {
  if (mqtt.version != 5) return "that needs mqtt.version 5";
  return mqtt.qos == 0 ? "that needs mqtt.qos 1" : "is its persistence on?";
}

void print_text(const Reception& reception, const std::string& base, const MqttConfig& mqtt) {
  std::cout << base << " on " << reception.server << ", " << tenth(reception.listened->count())
            << " s\n";
  const Interruptions& away = reception.interruptions;
  if (away.count > 0) {
    std::cout << "interruptions: " << away.count << ", " << tenth(away.total.count()) << " s; ";
    if (away.unkept == 0)
      std::cout << "the broker kept the messages\n";
    else
      std::cout << "in " << away.unkept
                << " of them the broker kept no messages: " << why_unkept(mqtt) << '\n';
  }
  for (const DeviceStream& stream : reception.streams) print(stream);
  if (!has_samples(reception.streams))
    std::cout << "no sample was received at all: is the agent running, and may this user read "
              << base << "/+/data/#?\n";
}

}  // namespace

int run_verify_stream(const Config& config, const VerifyStream& what) {
  log::set_level(log::Level::error);
  const std::string base = config.base_topic();
  StreamCheck check(base, sending_devices(config), boot_skip(config));
  Listener listener(connection_of(config.mqtt, what), base, std::move(check), what.listen,
                    names_for(what));
  const Reception reception = listener.run();
  if (!reception.fault.empty()) std::cerr << "verify-stream: " << reception.fault << '\n';
  if (!reception.listened) return kNotListened;
  if (what.as_json)
    print_json(reception, base);
  else
    print_text(reception, base, config.mqtt);
  return reception.fault.empty() ? status_of(reception.streams) : kNotListened;
}

}  // namespace fxagent
