#include "agent/http/exposition.h"

#include <prometheus/metric_family.h>
#include <prometheus/text_serializer.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstddef>
#include <functional>
#include <limits>
#include <optional>
#include <sstream>
#include <string_view>
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

double number(std::uint64_t count) { return static_cast<double>(count); }
double yes(bool is_so) { return is_so ? 1 : 0; }
double in_seconds(std::chrono::nanoseconds duration) {
  return std::chrono::duration<double>(duration).count();
}

// ---- metrics of each link and sample -----------------------------------------------------------

struct OfLink {
  std::string_view name;
  std::string_view help;
  MetricType type;
  double (*value)(const LinkHealth&);
};
constexpr std::array kOfLinks{
    OfLink{"fxagent_link_open", "1 if the port or the connection is open.", kGauge,
           [](const LinkHealth& link) { return yes(link.open); }},
    OfLink{"fxagent_exchanges_total", "Requests that were sent on the link.", kCounter,
           [](const LinkHealth& link) { return number(link.exchanges); }},
    OfLink{"fxagent_timeouts_total", "Exchanges without a complete answer in time.", kCounter,
           [](const LinkHealth& link) { return number(link.timeouts); }},
    OfLink{"fxagent_naks_total", "Exchanges that the device refused.", kCounter,
           [](const LinkHealth& link) { return number(link.naks); }},
    OfLink{"fxagent_bad_frames_total", "Exchanges with a damaged answer.", kCounter,
           [](const LinkHealth& link) { return number(link.bad_frames); }},
    OfLink{"fxagent_unexpected_bytes_total", "Unexpected bytes on the line.", kCounter,
           [](const LinkHealth& link) { return number(link.unexpected_bytes); }},
    OfLink{"fxagent_line_doubts_total", "Number of times that such bytes put the line in doubt.",
           kCounter, [](const LinkHealth& link) { return number(link.doubts); }},
    OfLink{"fxagent_line_doubted", "1 if the line is in doubt now.", kGauge,
           [](const LinkHealth& link) { return yes(link.doubted); }},
    OfLink{"fxagent_line_busy_ratio",
           "Share of the last 5 s that exchanges and their silences took.", kGauge,
           [](const LinkHealth& link) { return link.busy_percent / 100; }},
    OfLink{"fxagent_line_load_ratio",
           "Share of the line time that the poll intervals need; above 1 every group is polled "
           "less often.",
           kGauge, [](const LinkHealth& link) { return link.load_percent / 100; }}};

struct OfSamples {
  std::string_view name;
  std::string_view help;
  std::uint64_t SampleCounts::*count;
};
constexpr std::array kOfSamples{
    OfSamples{"fxagent_samples_collected_total", "Samples made since the start.",
              &SampleCounts::collected},
    OfSamples{"fxagent_samples_recovered_total", "Samples found on disk at the start.",
              &SampleCounts::recovered},
    OfSamples{"fxagent_samples_suppressed_total", "Samples not published because nothing changed.",
              &SampleCounts::suppressed},
    OfSamples{"fxagent_samples_acknowledged_total", "Samples acknowledged by the broker.",
              &SampleCounts::acknowledged},
    OfSamples{"fxagent_samples_dropped_total", "Samples lost.", &SampleCounts::dropped},
    OfSamples{"fxagent_samples_published_total", "Samples sent, repeats included.",
              &SampleCounts::published}};

// ---- the families -------------------------------------------------------------------------------

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
  void add(Labels labels, double value) {
    ClientMetric& made = series(std::move(labels));
    (family_.front().type == kCounter ? made.counter.value : made.gauge.value) = value;
  }
  /// Does nothing without a value.
  void add(Labels labels, std::optional<double> value) {
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
  void one(std::string_view name, MetricType type, std::string_view help, double value) {
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
        number(status_.rss_bytes));
    one("fxagent_clock_synchronised", kGauge, "1 if the clock of this machine is synchronised.",
        yes(status_.clock_synchronised));
    one("fxagent_identity_conflict", kGauge, "1 if another agent has the same id.",
        yes(!status_.conflict.empty()));
  }

  void of_broker() {
    one("fxagent_broker_connected", kGauge, "1 if the agent is connected to a broker.",
        yes(status_.broker.connected));
    one("fxagent_broker_subscribed", kGauge, "1 if the agent receives commands.",
        yes(status_.broker.subscribed));
  }

  void of_samples() {
    for (const OfSamples& each : kOfSamples)
      one(each.name, kCounter, each.help, number(status_.samples.*each.count));
    begin("fxagent_samples_waiting", kGauge,
          "Samples that the broker has not acknowledged yet, by place.");
    add({{"place", "queued"}}, number(status_.samples.queued));
    add({{"place", "in_flight"}}, number(status_.samples.in_flight));
    add({{"place", "stored"}}, number(status_.samples.stored));
    one("fxagent_samples_balanced", kGauge,
        "0 only because of a bug: samples are not accounted for.", yes(status_.samples.balanced()));
  }

  /// Adds a family with a series for each profile, unless there is none.
  template <class Value>
  void of_each_profile(std::string_view name, MetricType type, std::string_view help, Value value) {
    begin(name, type, help);
    for (const ProfileStatus& profile : status_.profiles)
      add({{"profile", profile.name}}, value(profile));
  }

  void of_profiles() {
    of_each_profile("fxagent_profile_connected", kGauge,
                    "1 if the profile is connected to its broker.",
                    [](const ProfileStatus& profile) { return yes(profile.connected); });
    of_each_profile("fxagent_profile_ready", kGauge, "1 if the profile sends samples.",
                    [](const ProfileStatus& profile) { return yes(profile.ready); });
    const auto count = [](std::uint64_t SampleCounts::*which) {
      return [which](const ProfileStatus& profile) { return number(profile.samples.*which); };
    };
    of_each_profile("fxagent_profile_samples_acknowledged_total", kCounter,
                    "Samples that the profile's broker acknowledged.",
                    count(&SampleCounts::acknowledged));
    of_each_profile("fxagent_profile_samples_dropped_total", kCounter,
                    "Samples lost for the profile.", count(&SampleCounts::dropped));
    of_each_profile("fxagent_profile_samples_waiting", kGauge,
                    "Samples that the profile's broker has not acknowledged yet.",
                    [](const ProfileStatus& profile) { return number(profile.samples.waiting()); });
  }

  void of_store() {
    if (!config_.store.path.empty())
      one("fxagent_store_on_disk", kGauge,
          "1 if the disk takes writes; 0: samples are in memory only.",
          yes(status_.store_state == "disk"));
    one("fxagent_store_bytes", kGauge, "Size of backlog and journal.", number(status_.store_bytes));
    if (status_.hours_left)
      one("fxagent_store_left_seconds", kGauge,
          "Time until the store is full if no sample can be sent.", *status_.hours_left * 3600);
    if (!status_.audit_head.empty())
      one("fxagent_audit_records", kGauge, "Records of the audit.", number(status_.audit_records));
  }

  void of_commands() {
    begin("fxagent_commands_total", kCounter, "Results of commands, by their status.");
    for (const CommandStatus status : kCommandStatuses) {
      const auto found = status_.commands.find(status);
      add({{"status", std::string(to_string(status))}},
          found == status_.commands.end() ? 0 : number(found->second));
    }
    begin("fxagent_command_duration_seconds", kHistogram,
          "Commands that were sent to a device: from arrival to the hand-over of the result.");
    add({}, status_.command_durations);
  }

  void of_links() {
    const auto& counters = status_.field->links;
    for (const OfLink& each : kOfLinks)
      of_each(each.name, each.type, each.help, config_.links, counters, each.value);
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
        return device == nullptr ? std::nullopt : std::optional(yes(is_so(*device)));
      };
    };
    of_each("fxagent_device_up", kGauge, "1 if the device answers.", config_.devices,
            status_.devices, whether(std::mem_fn(&DeviceStatus::is_alive)));
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
            [](const DeviceHealth& device) { return number(device.polls); });
    of_each("fxagent_missed_polls_total", kCounter, "Poll intervals skipped.", config_.devices,
            counters, [](const DeviceHealth& device) { return number(device.missed); });
    of_each("fxagent_device_samples_dropped_total", kCounter,
            "Samples of the device that are lost.", config_.devices, status_.dropped, number);
    of_each("fxagent_device_samples_refused", kGauge,
            "1 if the broker refuses the device's samples now.", config_.devices, status_.refused,
            [](const std::string& why) { return yes(!why.empty()); });
  }

  void of_connections() {
    begin("fxagent_http_connections_closed_total", kCounter,
          "Connections to this page that were closed before the answer was sent.");
    add({{"why", "slow"}}, number(closed_.slow));
    add({{"why", "crowded"}}, number(closed_.crowded));
    add({{"why", "unanswered"}}, number(closed_.unanswered));
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
