#include "agent/cli/check/check_target.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <utility>

#include "agent/cli/report/plan_report.h"
#include "agent/config/plain_topic.h"
#include "agent/config/read/findings.h"
#include "agent/config/read/sections.h"
#include "agent/config/suggestions.h"
#include "agent/handover/status.h"
#include "agent/text/text.h"
#include "agent/uplink/payload/json_payload.h"
#include "protocol/value/point.h"
#include "protocol/value/raw.h"

namespace fxagent {
namespace {

using Severity = TargetFinding::Severity;
using std::chrono::seconds;

constexpr std::size_t kKiB = 1024;
constexpr std::size_t kNone = std::numeric_limits<std::size_t>::max();
constexpr std::size_t kMostMessages = 20;

/// Proof of identity that a broker asks for.
enum class Login : std::uint8_t { any, certificate, password, certificate_or_password };

/// Limits of one broker. A default means that the broker has no such limit.
struct BrokerLimits {
  std::string_view name;  ///< as given to --target
  std::string_view broker;
  std::string_view old_mqtt{};  ///< versions without MQTT 5; empty: every version has it
  bool needs_tls = false;
  std::string_view wrong_port{};  ///< the end of a server's URL: ":443"
  std::string_view wrong_port_why{};
  Login login = Login::any;
  std::size_t client_id_bytes = kNone;
  seconds shortest_keep_alive{0};
  seconds longest_keep_alive = seconds::max();
  Severity other_keep_alive = Severity::refused;  ///< `warning`: it uses the nearest it accepts
  std::size_t topic_bytes = kNone;
  std::size_t topic_levels = kNone;
  std::string_view topic_without{};  ///< characters that a topic must not contain
  std::string_view topic_without_why{};
  std::size_t message_bytes = kNone;
  Severity too_large = Severity::refused;
  std::size_t retained_bytes = kNone;
  double messages_per_s = std::numeric_limits<double>::infinity();
  bool retained_by_wildcard = true;  ///< a subscription with + receives retained messages
};

constexpr auto kLimits = std::to_array<BrokerLimits>({
    // docs.aws.amazon.com/general/latest/gr/iot-core.html#message-broker-limits, and the section
    // "AWS IoT differences from MQTT specifications" of the developer guide.
    {.name = "aws",
     .broker = "AWS IoT Core",
     .needs_tls = true,
     .wrong_port = ":443",
     .wrong_port_why = "expects ALPN there, which the agent does not send",
     .login = Login::certificate,
     .client_id_bytes = 128,
     .shortest_keep_alive = seconds(30),
     .longest_keep_alive = seconds(1200),
     .other_keep_alive = Severity::warning,
     .topic_bytes = 256,
     .topic_levels = 8,
     .message_bytes = 128 * kKiB,
     .messages_per_s = 100,
     .retained_by_wildcard = false},
    // learn.microsoft.com/azure/event-grid/quotas-limits and mqtt-support, July 2025. Before May
    // 2025 a topic had at most 8 segments.
    {.name = "azure",
     .broker = "Azure Event Grid",
     .needs_tls = true,
     .wrong_port = ":443",
     .wrong_port_why = "speaks only MQTT over WebSocket there",
     .login = Login::certificate_or_password,
     .longest_keep_alive = seconds(1160),
     .topic_bytes = 256,
     .topic_levels = 15,
     .message_bytes = 512 * kKiB,
     .retained_bytes = 64 * kKiB,
     .messages_per_s = 1000},
    // docs.hivemq.com/hivemq-cloud, and community.hivemq.com/t/514. No document was found for the
    // size of a message.
    {.name = "hivemq",
     .broker = "HiveMQ Cloud",
     .needs_tls = true,
     .wrong_port = ":8884",
     .wrong_port_why = "speaks only MQTT over WebSocket there",
     .login = Login::password,
     .message_bytes = 5 * kKiB * kKiB,
     .too_large = Severity::warning},
    // docs.nats.io/running-a-nats-service/configuration/mqtt, and tried with 2.9.10. That version
    // does not apply max_payload to MQTT messages.
    {.name = "nats",
     .broker = "nats-server",
     .old_mqtt = "any version",
     .topic_without = " .",
     .topic_without_why =
         "(before 2.10 it closes the connection; since 2.10 a dot becomes // in the subject, and a "
         "space is still refused)",
     .message_bytes = kKiB * kKiB,
     .too_large = Severity::warning},
    // rabbitmq.com/docs/3.13/mqtt, and tried with 3.10.8.
    {.name = "rabbitmq",
     .broker = "RabbitMQ",
     .old_mqtt = "before 3.13",
     .topic_without = ".*",
     .topic_without_why = "(it delivers a dot as a slash and an asterisk as a plus, so commands "
                          "would not reach the agent)",
     .retained_by_wildcard = false},
});

const BrokerLimits* limits_of(std::string_view target) {
  const auto* found = std::ranges::find(kLimits, target, &BrokerLimits::name);
  return found == kLimits.end() ? nullptr : found;
}

std::size_t levels_of(std::string_view topic) {
  return static_cast<std::size_t>(std::ranges::count(topic, '/')) + 1;
}

/// Returns a value of the point that takes about as many bytes in JSON as any.
Value longest_value(const Point& point) {
  Scalar longest;
  switch (point.type) {
    case DataType::boolean:
      longest = false;
      break;
    case DataType::string:  // memory that is no text: JSON escapes each character
      longest = std::string(point.length, '\x01');
      break;
    case DataType::int64:
    case DataType::uint64:
      longest = BigInteger{"-9223372036854775808"};
      break;
    case DataType::float32:  // written with the digits of a float32, if it has no scale
      longest = point.scaled() ? std::numeric_limits<double>::lowest()
                               : double{-std::numeric_limits<float>::min()};
      break;
    case DataType::float64:
      longest = std::numeric_limits<double>::lowest();
      break;
    default: {
      const bool is_wide = bits_of_type(point.type) == 32;
      const double raw = is_wide ? std::numeric_limits<std::int32_t>::min() : -32768;
      longest = scaled_real(point, raw).value_or(Scalar(raw));
    }
  }
  if (!point.is_array) return Value(std::move(longest));
  return Value::array(Scalars(point.count, longest));
}

class Examination {
 public:
  Examination(const Config& config, std::string_view text, const BrokerLimits& limits)
      : config_(config), limits_(limits), places_(text), payload_(config, "00000000", "0.0.0") {}

  std::vector<TargetFinding> run() {
    look_at_connection();
    look_at_login();
    look_at_topics();
    look_at_messages();
    look_at_rate();
    look_at_differences();
    return std::move(found_);
  }

 private:
  void add(Severity severity, std::string pointer, std::string text) {
    const int line = places_.line(pointer);
    found_.push_back({severity, {std::move(pointer), line, std::move(text)}});
  }
  void refuse(std::string pointer, std::string text) {
    add(Severity::refused, std::move(pointer), std::move(text));
  }
  void warn(std::string pointer, std::string text) {
    add(Severity::warning, std::move(pointer), std::move(text));
  }
  std::string broker() const { return std::string(limits_.broker); }

  void look_at_connection() {
    const MqttConfig& mqtt = config_.mqtt;
    if (!limits_.old_mqtt.empty() && mqtt.version == 5)
      refuse("/mqtt/version", broker() + " (" + std::string(limits_.old_mqtt) +
                                  ") does not accept MQTT 5: set version to \"3.1.1\"");
    for (std::size_t i = 0; i < mqtt.servers.size(); ++i) {
      const std::string pointer = "/mqtt/servers/" + std::to_string(i);
      if (limits_.needs_tls && mqtt.servers[i].starts_with("mqtt://"))
        refuse(pointer, broker() + " accepts only TLS: write mqtts://HOST:8883");
      if (!limits_.wrong_port.empty() && mqtt.servers[i].ends_with(limits_.wrong_port))
        refuse(pointer, broker() + " " + std::string(limits_.wrong_port_why) + ": use port 8883");
    }
    if (mqtt.client_id.size() > limits_.client_id_bytes)
      refuse("/mqtt/client_id", broker() + " accepts a client id of at most " +
                                    counted(limits_.client_id_bytes, "byte") +
                                    ", and this one has " + std::to_string(mqtt.client_id.size()) +
                                    ": shorten it");
    const seconds keep_alive =
        std::clamp(mqtt.keep_alive, limits_.shortest_keep_alive, limits_.longest_keep_alive);
    if (keep_alive != mqtt.keep_alive)
      add(limits_.other_keep_alive, "/mqtt/keep_alive_s",
          limits_.other_keep_alive == Severity::warning
              ? broker() + " uses " + std::to_string(keep_alive.count()) + " s in place of this"
              : broker() + " accepts at most " + std::to_string(keep_alive.count()) +
                    " s: set a shorter keep alive");
  }

  void look_at_login() {
    const MqttConfig& mqtt = config_.mqtt;
    const bool certificate = mqtt.tls && !mqtt.tls->cert_file.empty();
    const bool password =
        !mqtt.username.empty() &&
        !(mqtt.password.empty() && mqtt.password_file.empty() && mqtt.password_env.empty());
    if (limits_.login == Login::certificate && !certificate)
      refuse("/mqtt/tls", broker() + " needs a client certificate: set cert_file and key_file");
    if (limits_.login == Login::password && !password)
      refuse("/mqtt", broker() + " needs a user and a password: set username and password_file");
    if (limits_.login != Login::certificate_or_password) return;
    if (!certificate && !password)
      refuse("/mqtt/tls", broker() +
                              " needs a client certificate: set cert_file and key_file, or for "
                              "webhook authentication username and password_file");
    else if (mqtt.username.empty())
      warn("/mqtt/username", broker() +
                                 " expects the client's authentication name in username, unless "
                                 "the namespace reads it from the certificate");
  }

  void look_at_topics() {
    const std::string base = config_.base_topic();
    std::string longest;
    std::string deepest;
    std::size_t too_long = 0;
    const auto look = [&](const std::string& topic) {
      if (topic.size() > limits_.topic_bytes) ++too_long;
      if (topic.size() > longest.size()) longest = topic;
      if (levels_of(topic) > levels_of(deepest)) deepest = topic;
    };
    look(payload_.last_will().topic);
    look(base + "/health");
    if (config_.remote.enabled) look(base + std::string(kReportedTopic));
    for (const LinkConfig& link : config_.links) look(base + "/" + link.name + "/command");
    for (const DeviceConfig& device : config_.devices) {
      look(base + "/" + device.name + "/command");
      for (const GroupConfig& group : device.groups)
        look(payload_.begin_history(0)->take({device.name, group.name}).at(0).topic);
    }
    for (const ProfileConfig& profile : config_.profiles) {
      if (profile.kind != ProfileConfig::Kind::plain || !profile.broker.empty()) continue;
      const auto topics = PlainTopic::parse(profile.topic, config_.root, config_.id).value();
      for (const DeviceConfig& device : config_.devices)
        for (const TagConfig& tag : device.tags)
          look(topics.of(device.name, device.groups.at(tag.group).name, tag.name) + "/history");
    }
    if (too_long > 0)
      refuse("/agent/root", broker() + " accepts topics of at most " +
                                counted(limits_.topic_bytes, "byte") + ", and " +
                                counted(too_long, "topic") + " of this config " +
                                (too_long == 1 ? "is" : "are") + " longer, the longest with " +
                                std::to_string(longest.size()) + ": " + longest +
                                "; shorten root, id, or the names of devices and groups");
    if (levels_of(deepest) > limits_.topic_levels)
      refuse("/agent/root",
             broker() + " accepts topics of at most " + counted(limits_.topic_levels, "level") +
                 ", and " + deepest + " has " + std::to_string(levels_of(deepest)) + ": remove " +
                 counted(levels_of(deepest) - limits_.topic_levels, "level") + " from root");
    const std::size_t wrong = config_.root.find_first_of(limits_.topic_without);
    if (wrong != std::string::npos)
      refuse("/agent/root", broker() + " does not accept '" + config_.root[wrong] +
                                "' in a topic " + std::string(limits_.topic_without_why) +
                                ": use another root");
    const bool has_sparkplug =
        std::ranges::any_of(config_.profiles, [](const ProfileConfig& profile) {
          return profile.kind == ProfileConfig::Kind::sparkplug && profile.broker.empty();
        });
    if (has_sparkplug && limits_.topic_without.find('.') != std::string_view::npos)
      refuse("/profiles", broker() + " does not accept '.' in a topic " +
                              std::string(limits_.topic_without_why) +
                              ", and Sparkplug's begin with spBv1.0: use another broker for this "
                              "profile");
  }

  void look_at_messages() {
    std::size_t unlisted = 0;
    const std::size_t before = found_.size();
    const auto look = [&](std::size_t bytes, std::size_t most, const DeviceConfig* device,
                          const std::string& what, const std::string& cure) {
      if (bytes <= most) return;
      if (found_.size() - before >= kMostMessages) {
        ++unlisted;
        return;
      }
      add(limits_.too_large, device != nullptr ? places_.device(device->name) : "/devices",
          what + " " + counted(bytes, "byte") + ", and " + broker() + " accepts " +
              std::to_string(most) + ": " + cure);
    };
    const std::size_t retained = std::min(limits_.retained_bytes, limits_.message_bytes);
    look(largest_health(config_), retained, nullptr, "the health of the agent has up to",
         "run several agents, each with a part of the links and devices");
    for (const DeviceConfig& device : config_.devices) {
      look(json::device_meta(device).text.size(), retained, &device,
           "the meta of " + device.name + " has",
           "divide its tags between several devices, or shorten descriptions and states");
      for (std::size_t group = 0; group < device.groups.size(); ++group)
        look(largest_history(payload_, device, group), limits_.message_bytes, &device,
             "a sample of group " + device.groups[group].name + " of " + device.name + " has up to",
             "divide its tags between several groups");
    }
    if (unlisted > 0) add(limits_.too_large, "/devices", unlisted_text(unlisted));
  }

  void look_at_rate() {
    if (std::isinf(limits_.messages_per_s)) return;
    std::map<StreamKey, std::optional<double>> cycle_s;  // of groups without an interval
    const auto is_free = [](const GroupConfig& group) { return group.interval.count() == 0; };
    if (std::ranges::any_of(config_.devices, [&](const DeviceConfig& device) {
          return std::ranges::any_of(device.groups, is_free);
        }))
      for (const LinkReport& link : plan_links(config_))
        for (const GroupLoad& load : link.groups)
          if (load.line_time)
            cycle_s[{load.device, load.group}] =
                std::chrono::duration<double>(*load.line_time).count();
    double always = 0;
    double changes = 0;
    std::size_t unknown = 0;
    for (const DeviceConfig& device : config_.devices)
      for (const GroupConfig& group : device.groups) {
        double cycle = std::chrono::duration<double>(group.interval).count();
        if (is_free(group)) cycle = cycle_s[{device.name, group.name}].value_or(0);
        if (cycle > 0)
          (group.on_change ? changes : always) += 1 / cycle;
        else
          ++unknown;
      }
    const auto text = [this](double rate) {
      return std::to_string(std::llround(rate)) + " messages a second, and " + broker() +
             " accepts " + std::to_string(std::llround(limits_.messages_per_s)) +
             " on a connection";
    };
    const std::string cure =
        ": set longer intervals, or publish: on_change, or gather tags in fewer groups";
    if (always > limits_.messages_per_s)
      refuse("/devices", "the groups publish " + text(always) + cure);
    else if (always + changes > limits_.messages_per_s)
      warn("/devices", "the groups publish up to " + text(always + changes) + cure);
    if (unknown > 0)
      warn("/devices", counted(unknown, "group") + " without an interval may publish more than " +
                           broker() + " accepts on a connection (" +
                           std::to_string(std::llround(limits_.messages_per_s)) +
                           " messages a second): set interval_ms");
  }

  void look_at_differences() {
    if (!limits_.retained_by_wildcard)
      warn("/mqtt", broker() +
                        " sends retained messages only to a subscription of the exact topic: the "
                        "agent does not find the topics of removed devices, and clients must "
                        "subscribe to states and meta by name");
    if (config_.remote.enabled && limits_.message_bytes < kMaxDesiredBytes)
      warn("/agent/remote_config", "a remote config has at most " +
                                       counted(limits_.message_bytes, "byte") +
                                       ": this broker does not deliver a larger one");
    if (limits_.name == "aws" && config_.mqtt.version == 5)
      warn("/mqtt/version",
           "the agent announces a Maximum Packet Size of 16 MiB, and AWS documents 128 KB as the "
           "largest; if it refuses the connection, set version to \"3.1.1\"");
    if (limits_.name == "rabbitmq" && config_.mqtt.username.empty() &&
        !std::ranges::all_of(config_.mqtt.servers, is_on_this_machine))
      warn("/mqtt/username",
           "RabbitMQ accepts its default user guest only from its own machine: set username and "
           "password_file");
  }

  const Config& config_;
  const BrokerLimits& limits_;
  ConfigPlaces places_;
  JsonPayload payload_;
  std::vector<TargetFinding> found_;
};

}  // namespace

int ConfigPlaces::line(std::string_view pointer) const {
  if (!tree_) return 0;
  const ConfigNode& at = tree_->nearest(pointer);
  return tree_->line_of(at.key_offset != 0 ? at.key_offset : at.offset);
}

std::string ConfigPlaces::device(std::string_view name) const {
  const ConfigNode* devices = tree_ ? tree_->root().find("devices") : nullptr;
  if (devices == nullptr) return "/devices";
  for (const ConfigNode& entry : devices->children)
    if (const ConfigNode* node = entry.find("name"); node != nullptr && node->text == name)
      return pointer_to(entry);
  return "/devices";
}

std::size_t largest_history(SamplePayload& payload, const DeviceConfig& device, std::size_t group) {
  constexpr std::int64_t kTime = 1'790'000'000'000;
  SampleRecord sample;
  sample.ts_ms = kTime;
  sample.seq = kTime;
  sample.boot = "00000000";
  sample.meta = "0000000000000000";
  sample.span_ms = 1234.5;
  for (const TagConfig& tag : device.tags) {
    if (tag.group != group) continue;
    sample.readings.push_back({.name = tag.name,
                               .type = tag.point.type,
                               .scaled = tag.point.scaled(),
                               .bad = BadReason::unsupported,
                               .value = longest_value(tag.point),
                               .bad_since_ms = kTime,
                               .last_ms = kTime});
  }
  const auto message = payload.begin_history(/*max_bytes=*/0);
  message->add(sample);
  return message->take({device.name, device.groups[group].name}).at(0).payload.size();
}

std::size_t largest_health(const Config& config) {
  constexpr std::uint64_t kCount = 9'999'999'999;
  constexpr Percentiles kLate{.p50 = 1234.5, .p99 = 1234.5};
  LinkHealth link;
  link.exchanges = link.timeouts = link.naks = link.bad_frames = kCount;
  link.unexpected_bytes = link.doubts = kCount;
  link.turnaround_ms = kLate;
  DeviceHealth device;
  device.polls = device.missed = kCount;
  device.late_ms = kLate;
  FieldHealth field;
  field.links.assign(config.links.size(), link);
  field.devices.assign(config.devices.size(), device);
  AgentStatus status;
  status.field = std::make_shared<const FieldHealth>(std::move(field));
  return json::health(status, config).size();
}

std::string target_fault(std::string_view target) {
  if (limits_of(target) != nullptr) return {};
  if (target == "iothub")
    return "Azure IoT Hub has fixed topics and is not an MQTT broker for this agent: use an Azure "
           "Event Grid namespace, and --target azure";
  return "there is no target " + shown(target) + did_you_mean(target, names_in(kLimits)) +
         "; the targets are aws, azure, hivemq, nats and rabbitmq";
}

std::string_view broker_of(std::string_view target) { return limits_of(target)->broker; }

std::vector<TargetFinding> target_findings(const Config& config, std::string_view text,
                                           std::string_view target) {
  return Examination(config, text, *limits_of(target)).run();
}

}  // namespace fxagent
