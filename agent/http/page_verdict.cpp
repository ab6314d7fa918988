#include "agent/http/page_verdict.h"

#include <algorithm>
#include <utility>

#include "agent/config/model.h"
#include "agent/text/text.h"

namespace fxagent {
namespace {

using State = DeviceStatus::State;

constexpr double kFullLoad = 100;
constexpr std::int64_t kDropCountsMs = 3'600'000;
// A clock before this day was never set: 2025-01-01.
constexpr std::int64_t kFirstSetMs = 1'735'689'600'000;

class Examination final {
 public:
  Examination(const AgentStatus& status, std::int64_t dropped_ms)
      : status_(status), config_(*status.config), dropped_ms_(dropped_ms) {}

  Verdict verdict() {
    broker();
    profiles();
    store();
    samples();
    config();
    devices();
    for (std::size_t l = 0; l < config_.links.size(); ++l)
      if (!config_.links[l].is_vacant()) link(l);
    if (status_.ts_ms < kFirstSetMs)
      add(Severity::bad, "", "The clock of this machine is not set; samples have wrong times",
          "Set the clock, and run chrony or systemd-timesyncd to keep it right.");
    std::ranges::stable_sort(problems_, [](const Problem& one, const Problem& other) {
      return one.severity != other.severity ? one.severity > other.severity
                                            : one.since_ms < other.since_ms;
    });
    return {std::move(problems_), works()};
  }

 private:
  void add(Severity severity, std::string place, std::string text, std::string cure,
           std::int64_t since_ms = 0) {
    problems_.push_back({severity, std::move(place), std::move(text), std::move(cure), since_ms});
  }

  void broker() {
    const BrokerStatus& broker = status_.broker;
    if (!broker.connected) {
      add(Severity::bad, "broker",
          "No connection to " + broker.server + (broker.why.empty() ? "" : ": " + broker.why),
          "Check that the broker runs and that this machine reaches it. The agent tries again by "
          "itself.",
          broker.since_ms);
    } else if (!broker.not_heard_why.empty()) {
      add(Severity::bad, "broker", "Commands are not received: " + broker.not_heard_why,
          "If the broker refuses the subscription, allow this client to subscribe to " +
              config_.base_topic() + "/+/command there.",
          broker.since_ms);
    }
    for (const std::string& what : broker.refused)
      add(Severity::bad, "broker", "The broker refuses " + what + " of the agent",
          "Allow this client to publish them: fxagent acl prints access rules for mosquitto. The "
          "log has the broker's reason.");
    if (!status_.conflict.empty())
      add(Severity::bad, "",
          "Another agent has the same id (boot " + status_.conflict +
              "); commands are rejected until one of them stops",
          "Give each agent its own agent.id.");
  }

  void profiles() {
    for (const ProfileStatus& profile : status_.profiles) {
      const std::string place = "profile " + profile.name;
      if (!profile.connected)
        add(Severity::warn, place,
            "The profile " + profile.name + " has no connection to " + profile.server +
                (profile.why.empty() ? "" : ": " + profile.why),
            "Check that this broker runs and that this machine reaches it. The agent tries again "
            "by itself; samples wait.");
      else if (!profile.ready)
        add(Severity::warn, place,
            "The profile " + profile.name + " is connected but does not send samples yet",
            "If the config names a `host`, start that host application; samples wait for it.");
    }
  }

  void store() {
    if (config_.store.path.empty()) return;
    if (status_.store_state == "hangs")
      add(Severity::bad, "store", "The disk of the store does not respond",
          "Check the disk under " + config_.store.path +
              ". Samples wait in memory; commands that write are rejected.",
          status_.store_since_ms);
    else if (status_.store_state == "memory")
      add(Severity::bad, "store",
          "The store on disk cannot be written; samples and audit records are in memory only",
          "Check free space and rights of " + config_.store.path +
              ", and the log. Do not restart the agent before: a restart loses them.",
          status_.store_since_ms);
    if (!status_.store_set_aside.empty())
      add(Severity::warn, "store", "A damaged store was set aside: " + status_.store_set_aside,
          "Check the disk. The file can be kept for a repair, or be deleted.");
  }

  void config() {
    const auto& reload = status_.config_status.last_reload;
    if (!reload || reload->state != "rejected") return;
    add(Severity::warn, "config",
        "The last reload was rejected" +
            (reload->errors.empty() ? std::string() : ": " + reload->errors.front()),
        "Correct the file, try it with `fxagent check`, and reload. The previous config is in "
        "force.",
        reload->ts_ms);
  }

  void samples() {
    if (dropped_ms_ == 0 || status_.ts_ms - dropped_ms_ > kDropCountsMs) return;
    add(Severity::bad, "store",
        counted(status_.samples.dropped, "sample") + " were dropped since the start",
        config_.store.path.empty()
            ? "Add a `store` to the config, so that samples wait on disk for the broker."
            : "Make store.max_bytes larger, or find in the events why the broker takes too few.",
        dropped_ms_);
  }

  /// Counts the devices, and reports what is wrong with one whose link has others that answer.
  void devices() {
    links_.resize(config_.links.size());
    for (std::size_t d = 0; d < config_.devices.size(); ++d) {
      const DeviceConfig& device = config_.devices[d];
      if (device.is_vacant()) continue;
      ++devices_;
      const DeviceStatus* state = d < status_.devices.size() ? status_.devices[d].get() : nullptr;
      Link& link = links_.at(device.link);
      ++link.devices;
      if (state != nullptr && state->is_alive()) ++online_;
      if (state != nullptr && (state->state != State::online || !state->reason_text.empty()))
        link.wrong.push_back(d);
      if (state != nullptr && state->state == State::offline && state->reason != "starting")
        ++link.silent;
      if (status_.broker.connected && d < status_.refused.size() && !status_.refused[d].empty())
        add(Severity::bad, "device " + device.name,
            "The broker refuses the samples of " + device.name + " with " + status_.refused[d],
            "Allow this client to publish below " + config_.base_topic() + "/" + device.name +
                " on the broker.");
    }
  }

  void device(std::size_t index) {
    const std::string& name = config_.devices[index].name;
    const DeviceStatus& state = *status_.devices[index];
    const bool is_offline = state.state == State::offline;
    add(is_offline && state.reason != "starting" ? Severity::bad : Severity::warn, "device " + name,
        name +
            (is_offline                       ? " does not answer"
             : state.state == State::degraded ? " answers in part"
                                              : " is not as configured") +
            (state.reason.empty() ? "" : " (" + state.reason + ")"),
        state.reason_text, state.since_ms);
  }

  /// Devices that fall silent together have one cause: it is reported once.
  void link(std::size_t index) {
    const Link& link = links_[index];
    const std::string& name = config_.links[index].name;
    const std::string place = "link " + name;
    const auto state_of = [&](std::size_t d) -> const DeviceStatus& { return *status_.devices[d]; };
    const auto yielded = std::ranges::find(link.wrong, State::yielded,
                                           [&](std::size_t d) { return state_of(d).state; });
    if (yielded != link.wrong.end())
      return add(Severity::warn, place,
                 "Link " + name + " is not read: " + state_of(*yielded).reason_text,
                 "The agent takes the port back by itself, or at once with the command resume.",
                 state_of(*yielded).since_ms);
    const bool is_down = link.silent > 0 && std::ranges::all_of(link.wrong, [&](std::size_t d) {
                           return state_of(d).reason == "link_down";
                         });
    if (link.silent > 0 && link.silent == link.devices && (is_down || link.silent > 1)) {
      const std::size_t first = *std::ranges::min_element(
          link.wrong, {}, [&](std::size_t d) { return state_of(d).since_ms; });
      const std::string whom =
          link.devices == 1 ? config_.devices[first].name : counted(link.devices, "device");
      add(Severity::bad, place,
          is_down ? "Link " + name + " is down, and " + whom + " cannot be reached"
                  : "None of the " + whom + " on " + name + " answers",
          state_of(first).reason_text, state_of(first).since_ms);
    } else {
      for (const std::size_t d : link.wrong) device(d);
    }
    if (index >= status_.field->links.size()) return;
    const LinkHealth& health = status_.field->links[index];
    if (health.doubted)
      add(Severity::warn, place, "Bytes that belong to no answer arrive on " + name,
          "Check for a second master, two devices with one station number, and the earth of the "
          "shield.");
    if (health.load_percent > kFullLoad)
      add(Severity::warn, place,
          "The polls of " + name + " need " +
              std::to_string(static_cast<std::int64_t>(health.load_percent)) +
              " % of the line, so groups are read less often than configured",
          "Raise interval_ms of its largest groups, which the view Lines shows, or the baud rate.");
  }

  std::string works() const {
    std::string text = std::to_string(online_) + " of " + counted(devices_, "device") +
                       (online_ == 1 ? " answers" : " answer");
    if (status_.broker.connected) return text + "; the broker is connected";
    const SampleCounts& samples = status_.samples;
    if (samples.waiting() > 0)
      text += "; " + counted(samples.waiting(), "sample") + " kept for the broker";
    if (samples.stored > 0 && status_.store_state == "disk")
      text += ", " + std::to_string(samples.stored) + " of them on disk";
    return text;
  }

  /// The devices of a link.
  struct Link {
    std::size_t devices = 0;
    std::size_t silent = 0;            ///< offline, and not only starting
    std::vector<std::size_t> wrong{};  ///< not online, or with something to check
  };

  const AgentStatus& status_;
  const Config& config_;
  const std::int64_t dropped_ms_;
  std::vector<Problem> problems_;
  std::vector<Link> links_;  ///< by index in Config::links
  std::size_t devices_ = 0;
  std::size_t online_ = 0;
};

}  // namespace

Verdict verdict_of(const AgentStatus& status, std::int64_t dropped_ms) {
  return Examination(status, dropped_ms).verdict();
}

}  // namespace fxagent
