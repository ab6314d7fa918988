#include "agent/http/exposition.h"

#include <prometheus/metric_family.h>
#include <prometheus/text_serializer.h>

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <functional>
#include <limits>
#include <optional>
#include <sstream>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "agent/config/model.h"

namespace fxagent {
namespace {

using prometheus::ClientMetric;
using prometheus::MetricFamily;
using prometheus::MetricType;
using Labels = std::vector<ClientMetric::Label>;

constexpr auto kCounter = MetricType::Counter;
constexpr auto kGauge = MetricType::Gauge;
constexpr auto kHistogram = MetricType::Histogram;

double in_seconds(std::chrono::nanoseconds duration) {
  return std::chrono::duration<double>(duration).count();
}

/// One page. Writes each family as soon as it is complete: with many links they are large.
class Page final {
 public:
  Page(const AgentStatus& status, const HttpServer::Closed& closed)
      : status_(status), config_(*status.config), closed_(closed) {}

  std::string text() {
    of_agent();
    of_broker();
    of_samples();
    of_profiles();
    of_store();
    of_commands();
    of_links();
    of_devices();
    of_connections();
    write();
    return std::move(out_).str();
  }

 private:
  void begin(std::string_view name, MetricType type, std::string_view help) {
    write();
    MetricFamily& family = family_.emplace_back();
    family.name = name;
    family.type = type;
    family.help = help;
  }
  /// Writes the current family, unless it has no series.
  void write() {
    if (!family_.empty() && !family_.front().metric.empty())
      prometheus::TextSerializer().Serialize(out_, family_);
    family_.clear();
  }

  ClientMetric& series(Labels labels) {
    ClientMetric& made = family_.front().metric.emplace_back();
    made.label = std::move(labels);
    return made;
  }
  /// Adds a series; true is 1.
  template <class Number>
  requires std::is_arithmetic_v<Number>
  void add(Labels labels, Number value) {
    ClientMetric& made = series(std::move(labels));
    (family_.front().type == kCounter ? made.counter.value : made.gauge.value) =
        static_cast<double>(value);
  }
  /// Does nothing without a value.
  template <class Number>
  void add(Labels labels, std::optional<Number> value) {
    if (value) add(std::move(labels), *value);
  }
  void add(Labels labels, const DurationHistogram& durations) {
    ClientMetric& made = series(std::move(labels));
    std::uint64_t count = 0;
    for (std::size_t i = 0; i < durations.counts().size(); ++i) {
      count += durations.counts()[i];
      auto& bucket = made.histogram.bucket.emplace_back();
      bucket.cumulative_count = count;
      bucket.upper_bound = i < DurationHistogram::kBounds.size()
                               ? in_seconds(DurationHistogram::kBounds[i])
                               : std::numeric_limits<double>::infinity();
    }
    made.histogram.sample_count = count;
    made.histogram.sample_sum = in_seconds(durations.sum());
  }
  /// Adds a family of one series.
  template <class Number>
  void one(std::string_view name, MetricType type, std::string_view help, Number value) {
    begin(name, type, help);
    add({}, value);
  }

  static Labels labels_of(const LinkConfig& link) { return {{"link", link.name}}; }
  Labels labels_of(const DeviceConfig& device) const {
    return {{"device", device.name}, {"link", config_.links[device.link].name}};
  }

  /// Adds a family with a series for each link or device, except vacant places that a reload
  /// leaves. `list` is indexed as `places`, and may be shorter.
  template <class Places, class List, class Value>
  void of_each(std::string_view name, MetricType type, std::string_view help, const Places& places,
               const List& list, Value value) {
    begin(name, type, help);
    for (std::size_t i = 0; i < std::min(list.size(), places.size()); ++i)
      if (!places[i].is_vacant()) add(labels_of(places[i]), std::invoke(value, list[i]));
  }

  void of_agent() {
    begin("fxagent_build_info", kGauge, "The agent's id and version; the value is 1.");
    add({{"agent", config_.id}, {"version", status_.version}}, 1);
    one("fxagent_uptime_seconds", kGauge, "Time since the start.", in_seconds(status_.uptime));
    one("process_resident_memory_bytes", kGauge, "Resident memory of the process.",
        status_.rss_bytes);
    one("fxagent_clock_synchronised", kGauge, "1 if the clock of this machine is synchronised.",
        status_.clock_synchronised);
    one("fxagent_identity_conflict", kGauge, "1 if another agent has the same id.",
        !status_.conflict.empty());
  }

  void of_broker() {
    one("fxagent_broker_connected", kGauge, "1 if the agent is connected to a broker.",
        status_.broker.connected);
    one("fxagent_broker_subscribed", kGauge, "1 if the agent receives commands.",
        status_.broker.subscribed);
  }

  void of_samples() {
    const SampleCounts& samples = status_.samples;
    one("fxagent_samples_collected_total", kCounter, "Samples made since the start.",
        samples.collected);
    one("fxagent_samples_recovered_total", kCounter, "Samples found on disk at the start.",
        samples.recovered);
    one("fxagent_samples_suppressed_total", kCounter,
        "Samples not published because nothing changed.", samples.suppressed);
    one("fxagent_samples_acknowledged_total", kCounter, "Samples acknowledged by the broker.",
        samples.acknowledged);
    one("fxagent_samples_dropped_total", kCounter, "Samples lost.", samples.dropped);
    one("fxagent_samples_published_total", kCounter, "Samples sent, repeats included.",
        samples.published);
    begin("fxagent_samples_waiting", kGauge,
          "Samples that the broker has not acknowledged yet, by place.");
    add({{"place", "queued"}}, samples.queued);
    add({{"place", "in_flight"}}, samples.in_flight);
    add({{"place", "stored"}}, samples.stored);
    one("fxagent_samples_balanced", kGauge,
        "0 only because of a bug: samples are not accounted for.", samples.balanced());
  }

  /// Adds a family with a series for each profile, unless there is none.
  template <class Value>
  void of_each_profile(std::string_view name, MetricType type, std::string_view help, Value value) {
    begin(name, type, help);
    for (const ProfileStatus& profile : status_.profiles)
      add({{"profile", profile.name}}, std::invoke(value, profile));
  }

  void of_profiles() {
    of_each_profile("fxagent_profile_connected", kGauge,
                    "1 if the profile is connected to its broker.", &ProfileStatus::connected);
    of_each_profile("fxagent_profile_ready", kGauge, "1 if the profile sends samples.",
                    &ProfileStatus::ready);
    of_each_profile("fxagent_profile_samples_acknowledged_total", kCounter,
                    "Samples that the profile's broker acknowledged.",
                    [](const ProfileStatus& profile) { return profile.samples.acknowledged; });
    of_each_profile("fxagent_profile_samples_dropped_total", kCounter,
                    "Samples lost for the profile.",
                    [](const ProfileStatus& profile) { return profile.samples.dropped; });
    of_each_profile("fxagent_profile_samples_waiting", kGauge,
                    "Samples that the profile's broker has not acknowledged yet.",
                    [](const ProfileStatus& profile) { return profile.samples.waiting(); });
  }

  void of_store() {
    if (!config_.store.path.empty())
      one("fxagent_store_on_disk", kGauge,
          "1 if the disk takes writes; 0: samples are in memory only.",
          status_.store_state == "disk");
    one("fxagent_store_bytes", kGauge, "Size of backlog and journal.", status_.store_bytes);
    if (status_.hours_left)
      one("fxagent_store_left_seconds", kGauge,
          "Time until the store is full if no sample can be sent.", *status_.hours_left * 3600);
    if (!status_.audit_head.empty())
      one("fxagent_audit_records", kGauge, "Records of the audit.", status_.audit_records);
  }

  void of_commands() {
    begin("fxagent_commands_total", kCounter, "Results of commands, by their status.");
    for (const CommandStatus status : kCommandStatuses) {
      const auto found = status_.commands.find(status);
      add({{"status", std::string(to_string(status))}},
          found == status_.commands.end() ? 0 : found->second);
    }
    begin("fxagent_command_duration_seconds", kHistogram,
          "Commands that were sent to a device: from arrival to the hand-over of the result.");
    add({}, status_.command_durations);
  }

  void of_links() {
    const auto each = [this](std::string_view name, MetricType type, std::string_view help,
                             auto value) {
      of_each(name, type, help, config_.links, status_.field->links, value);
    };
    each("fxagent_link_open", kGauge, "1 if the port or the connection is open.",
         &LinkHealth::open);
    each("fxagent_exchanges_total", kCounter, "Requests that were sent on the link.",
         &LinkHealth::exchanges);
    each("fxagent_timeouts_total", kCounter, "Exchanges without a complete answer in time.",
         &LinkHealth::timeouts);
    each("fxagent_naks_total", kCounter, "Exchanges that the device refused.", &LinkHealth::naks);
    each("fxagent_bad_frames_total", kCounter, "Exchanges with a damaged answer.",
         &LinkHealth::bad_frames);
    each("fxagent_unexpected_bytes_total", kCounter, "Unexpected bytes on the line.",
         &LinkHealth::unexpected_bytes);
    each("fxagent_line_doubts_total", kCounter,
         "Number of times that such bytes put the line in doubt.", &LinkHealth::doubts);
    each("fxagent_line_doubted", kGauge, "1 if the line is in doubt now.", &LinkHealth::doubted);
    each("fxagent_line_busy_ratio", kGauge,
         "Share of the last 5 s that exchanges and their silences took.",
         [](const LinkHealth& link) { return link.busy_percent / 100; });
    each("fxagent_line_load_ratio", kGauge,
         "Share of the line time that the poll intervals need; above 1 every group is polled less "
         "often.",
         [](const LinkHealth& link) { return link.load_percent / 100; });
    const auto& durations = status_.field->durations;
    of_each("fxagent_exchange_turnaround_seconds", kHistogram,
            "The devices' own time in exchanges that were answered.", config_.links, durations,
            &LinkDurations::turnaround);
    of_each("fxagent_poll_lateness_seconds", kHistogram,
            "Delay of poll cycles after their due time.", config_.links, durations,
            &LinkDurations::lateness);
  }

  void of_devices() {
    const auto whether = [](auto is_so) {
      return [is_so](const auto& device) {
        return device == nullptr ? std::nullopt : std::optional<bool>(std::invoke(is_so, *device));
      };
    };
    of_each("fxagent_device_up", kGauge, "1 if the device answers.", config_.devices,
            status_.devices, whether(&DeviceStatus::is_alive));
    of_each("fxagent_device_degraded", kGauge,
            "1 if the device answers but a tag is bad or its model is not known.", config_.devices,
            status_.devices, whether([](const DeviceStatus& device) {
              return device.state == DeviceStatus::State::degraded;
            }));
    of_each("fxagent_device_other_model", kGauge,
            "1 if the PLC is another model than the config says.", config_.devices, status_.devices,
            whether([](const DeviceStatus& device) { return !device.model_configured.empty(); }));
    const auto& counters = status_.field->devices;
    of_each("fxagent_polls_total", kCounter, "Poll cycles begun.", config_.devices, counters,
            &DeviceHealth::polls);
    of_each("fxagent_missed_polls_total", kCounter, "Poll intervals skipped.", config_.devices,
            counters, &DeviceHealth::missed);
    of_each("fxagent_device_samples_dropped_total", kCounter,
            "Samples of the device that are lost.", config_.devices, status_.dropped,
            std::identity());
    of_each("fxagent_device_samples_refused", kGauge,
            "1 if the broker refuses the device's samples now.", config_.devices, status_.refused,
            [](const std::string& why) { return !why.empty(); });
  }

  void of_connections() {
    begin("fxagent_http_connections_closed_total", kCounter,
          "Connections to this page that were closed before the answer was sent.");
    add({{"why", "slow"}}, closed_.slow);
    add({{"why", "crowded"}}, closed_.crowded);
    add({{"why", "unanswered"}}, closed_.unanswered);
  }

  const AgentStatus& status_;
  const Config& config_;
  const HttpServer::Closed& closed_;
  std::vector<MetricFamily> family_;  ///< the current one, or none
  std::ostringstream out_;
};

}  // namespace

std::string exposition(const AgentStatus& status, const HttpServer::Closed& closed) {
  return Page(status, closed).text();
}

}  // namespace fxagent
