#include "agent/cli/verify_stream.h"

#include <poll.h>
#include <signal.h>
#include <sys/eventfd.h>
#include <sys/signalfd.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <iostream>
#include <nlohmann/json.hpp>
#include <optional>
#include <random>
#include <stdexcept>
#include <utility>
#include <vector>

#include "agent/cli/stream_check.h"
#include "agent/log/log.h"
#include "agent/text.h"
#include "agent/uplink/paho/paho_broker.h"

namespace fxagent {
namespace {

using Seconds = std::chrono::duration<double>;

constexpr int kWhole = 0;
constexpr int kNotWhole = 1;
constexpr int kNoBroker = 2;

constexpr std::chrono::seconds kPatience{30};  // longer than the connect time-out of the MQTT
                                               // library
// A single row may exceed the target size of a history message. The broker gets the same limit.
constexpr std::size_t kMaxPayload = std::size_t{16} << 20;

SteadyTime now() { return std::chrono::steady_clock::now(); }

/// Connection to the broker. This thread can wait for its events, and for signals that end the
/// wait.
class Connection final {
 public:
  enum class Woken : std::uint8_t { news, time_is_up, stop_asked };

  explicit Connection(const MqttConfig& config)
      : news_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)),
        signals_(block_signals()),
        broker_(
            config, /*make_will=*/{},
            [this] {
              const std::uint64_t one = 1;
              // Fails only if the counter is full, and then an event is pending anyway.
              [[maybe_unused]] const auto written = write(news_, &one, sizeof one);
            },
            kMaxPayload) {
    if (news_ < 0 || signals_ < 0) throw std::runtime_error("no file handle left to wait with");
  }
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  Broker& broker() { return broker_; }

  Woken wait_until(SteadyTime deadline) {
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - now()).count();
    if (left <= 0) return Woken::time_is_up;
    pollfd waited[] = {{news_, POLLIN, 0}, {signals_, POLLIN, 0}};
    poll(waited, 2, static_cast<int>(std::min<std::int64_t>(left, 3'600'000)));
    if (waited[1].revents != 0) return Woken::stop_asked;
    std::uint64_t count = 0;
    [[maybe_unused]] const auto read_bytes = read(news_, &count, sizeof count);
    return Woken::news;
  }

 private:
  /// File descriptor, closed after the broker that uses it.
  class Handle final {
   public:
    explicit Handle(int fd) : fd_(fd) {}
    ~Handle() {
      if (fd_ >= 0) close(fd_);
    }
    Handle(const Handle&) = delete;
    Handle& operator=(const Handle&) = delete;
    operator int() const { return fd_; }

   private:
    int fd_;
  };

  /// Runs before the library starts a thread, so that no such thread receives these signals.
  static int block_signals() {
    sigset_t stop;
    sigemptyset(&stop);
    sigaddset(&stop, SIGINT);
    sigaddset(&stop, SIGTERM);
    pthread_sigmask(SIG_BLOCK, &stop, nullptr);
    return signalfd(-1, &stop, SFD_CLOEXEC);
  }

  Handle news_;
  Handle signals_;
  PahoBroker broker_;  // last: its callbacks use the others
};

/// Connects, subscribes, listens and passes every message to the check.
class Listener final {
 public:
  Listener(const MqttConfig& config, std::string base, StreamCheck check,
           std::chrono::seconds listen)
      : servers_(config.servers),
        filters_{base + "/+/data/+/history", base + "/+/data/+"},
        listen_(listen),
        check_(std::move(check)),
        connection_(config) {}

  /// Runs until the time is up, a signal arrives or the connection is lost. Returns an empty text
  /// if it listened to the end, else the reason.
  std::string run() {
    using Woken = Connection::Woken;
    connection_.broker().connect(server_, kReceiveMaximum);
    deadline_ = now() + kPatience;
    auto woken = Woken::news;
    while (woken == Woken::news && !over_) {
      woken = connection_.wait_until(deadline_);
      for (const BrokerEvent& event : connection_.broker().take_events())
        std::visit([this](const auto& e) { on(e); }, event);
    }
    ended_ = now();
    if (!over_ && !begun_)
      fault_ = woken == Woken::stop_asked ? "stopped before it could listen"
                                          : servers_.at(server_) + ": no answer";
    return fault_;
  }

  const std::string& server() const { return servers_.at(server_); }
  bool has_listened() const { return begun_.has_value(); }
  Seconds listened() const { return begun_ ? Seconds(ended_ - *begun_) : Seconds(0); }
  std::vector<DeviceStream> report() const { return check_.report(); }

 private:
  void on(const Connected&) { subscribe(); }
  void on(const ConnectFailed& event) {
    fault_ += (fault_.empty() ? "" : "; ") + servers_.at(server_) + ": " + event.text;
    if (server_ + 1 == servers_.size()) return end(fault_);
    deadline_ = now() + kPatience;
    connection_.broker().connect(++server_, kReceiveMaximum);
  }
  void on(const Subscribed& event) {
    if (!event.granted)
      return end(server() + ": the broker refuses " + event.filter + ": " + event.text);
    if (++subscribed_ < filters_.size()) return subscribe();
    fault_.clear();
    begun_ = now();
    deadline_ = *begun_ + listen_;
  }
  void on(const Message& event) { check_.take(event.topic, event.payload, event.retained); }
  void on(const Lost& event) { end(server() + ": lost: " + event.text); }
  void on(const MessagesDropped& event) {
    end("this program was too slow: " + std::to_string(event.count) +
        " messages were not looked at");
  }
  void on(const Disconnected&) {}
  void on(const Delivered&) {}
  void on(const DeliveryFailed&) {}

  /// Subscribes to history first: history that a live sample makes due must not be missed.
  void subscribe() {
    connection_.broker().subscribe({filters_.at(subscribed_), /*no_local=*/false});
  }
  void end(std::string fault) {
    over_ = true;
    fault_ = std::move(fault);
  }

  const std::vector<std::string> servers_;
  const std::array<std::string, 2> filters_;
  const std::chrono::seconds listen_;
  StreamCheck check_;
  std::size_t server_ = 0;
  std::size_t subscribed_ = 0;
  SteadyTime deadline_{};
  std::optional<SteadyTime> begun_;
  SteadyTime ended_{};
  bool over_ = false;
  std::string fault_;
  Connection connection_;  // last, so that it is destroyed first
};

/// Returns the config with its own client id, which two clients of a broker cannot share, and with
/// the credentials given on the command line.
MqttConfig connection_of(const MqttConfig& config, const VerifyStream& what) {
  MqttConfig own = config;
  char suffix[17];
  std::snprintf(suffix, sizeof suffix, "-verify-%08x", std::random_device{}());
  own.client_id += suffix;
  if (what.username.empty() && what.password_file.empty() && what.password_env.empty()) return own;
  if (!what.username.empty()) own.username = what.username;
  own.password.clear();
  own.password_file = what.password_file;
  own.password_env = what.password_env;
  return own;
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
  return more == 0 ? text : text + " and " + std::to_string(more) + " ranges more";
}

void print(const DeviceStream& stream) {
  const auto line = [](const std::string& text) { std::cout << "  " << text << '\n'; };
  std::cout << escaped(stream.device, Escape::terminal) << ": ";
  if (!stream.decided)
    std::cout << (stream.history == 0 ? "nothing came" : "no live sample came");
  else if (stream.missing.numbers == 0)
    std::cout << "nothing is missing";
  else
    std::cout << stream.missing.numbers << " missing: " << text_of(stream.missing);
  std::cout << '\n';
  if (stream.seen)
    line(std::to_string(stream.live) + " live and " + std::to_string(stream.history) +
         " history samples, numbers " + std::to_string(stream.seen->first) + " to " +
         std::to_string(stream.seen->last));
  if (stream.skipped.numbers > 0)
    line("left out by a new boot: " + std::to_string(stream.skipped.numbers) + ": " +
         text_of(stream.skipped));
  if (stream.repeated > 0)
    line("repeated: " + std::to_string(stream.repeated) +
         (stream.differing == 0
              ? ", always the same sample"
              : ", " + std::to_string(stream.differing) + " of them with ANOTHER sample"));
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

}  // namespace

int run_verify_stream(const Config& config, const VerifyStream& what) {
  log::set_level(log::Level::error);
  const bool keeps_numbers = !config.store.path.empty() && config.store.sync_always;
  Listener listener(connection_of(config.mqtt, what), config.base_topic(),
                    StreamCheck(config.base_topic(), sending_devices(config),
                                keeps_numbers ? BootSkip::is_loss : BootSkip::allowed),
                    what.listen);
  const std::string fault = listener.run();
  if (!fault.empty()) std::cerr << "verify-stream: " << fault << '\n';
  if (!listener.has_listened()) return kNoBroker;

  const auto streams = listener.report();
  const bool any = std::ranges::any_of(
      streams, [](const DeviceStream& stream) { return stream.seen.has_value(); });
  const bool whole = any && std::ranges::all_of(streams, &DeviceStream::is_whole);
  const double seconds = std::round(listener.listened().count() * 10) / 10;
  if (what.as_json) {
    OrderedJson out;
    out["ok"] = fault.empty() && whole;
    out["error"] = fault.empty() ? OrderedJson() : OrderedJson(fault);
    out["base"] = config.base_topic();
    out["server"] = listener.server();
    out["seconds"] = seconds;
    auto& devices = out["devices"] = OrderedJson::array();
    for (const DeviceStream& stream : streams) devices.push_back(json_of(stream));
    std::cout << out.dump() << '\n';
  } else {
    std::cout << config.base_topic() << " on " << listener.server() << ", " << seconds << " s\n";
    for (const DeviceStream& stream : streams) print(stream);
    if (!any)
      std::cout << "nothing came at all: is the agent running, and may this user read "
                << config.base_topic() << "/+/data/#?\n";
  }
  if (!fault.empty()) return kNoBroker;
  return whole ? kWhole : kNotWhole;
}

}  // namespace fxagent
