#include "agent/http/page_verdict.h"

#include <algorithm>
#include <utility>

#include "agent/config/model.h"

namespace fxagent {
namespace {

using State = DeviceStatus::State;

/// Returns the number with its noun: "1 device", "3 devices".
std::string counted(std::size_t count, const std::string& noun) {
  return std::to_string(count) + " " + noun + (count == 1 ? "" : "s");
}

class Examination final {
 public:
  explicit Examination(const AgentStatus& status) : status_(status), config_(*status.config) {}

  Verdict verdict() {
    broker();
    store();
    config();
    devices();
    std::ranges::stable_sort(problems_, [](const Problem& one, const Problem& other) {
      return one.severity != other.severity ? one.severity > other.severity
                                            : one.since_ms < other.since_ms;
    });
    return {std::move(problems_), works()};
  }

 private:
  void add(Severity severity, std::string place, std::string text, std::string cure,
           std::int64_t since_ms) {
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
          "Allow this client to subscribe to " + config_.base_topic() + "/+/command on the broker.",
          broker.since_ms);
    }
    if (!status_.conflict.empty())
      add(Severity::bad, "",
          "Another agent has the same id (boot " + status_.conflict +
              "); commands are rejected until one of them stops",
          "Give each agent its own agent.id.", 0);
  }

  void store() {
    if (config_.store.path.empty()) return;
    if (status_.store_state == "hangs")
      add(Severity::bad, "store", "The disk of the store does not respond",
          "Check the disk under " + config_.store.path + ". Samples wait in memory.", 0);
    else if (status_.store_state == "memory")
      add(Severity::bad, "store", "The store on disk cannot be written; samples wait in memory",
          "Check free space and rights of " + config_.store.path + ", and the log.", 0);
    if (!status_.store_set_aside.empty())
      add(Severity::warn, "store", "A damaged store was set aside: " + status_.store_set_aside,
          "Check the disk. The file can be kept for a repair, or be deleted.", 0);
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

  void devices() {
    for (std::size_t d = 0; d < config_.devices.size(); ++d) {
      const DeviceConfig& device = config_.devices[d];
      if (device.is_vacant()) continue;
      ++devices_;
      const DeviceStatus* state = d < status_.devices.size() ? status_.devices[d].get() : nullptr;
      if (state == nullptr || state->state == State::online) {
        online_ += state == nullptr ? 0U : 1U;
      } else {
        const bool is_offline = state->state == State::offline;
        if (!is_offline) ++online_;
        add(is_offline && state->reason != "starting" ? Severity::bad : Severity::warn,
            "device " + device.name,
            device.name + (is_offline ? " does not answer" : " answers in part") +
                (state->reason.empty() ? "" : " (" + state->reason + ")"),
            state->reason_text, state->since_ms);
      }
      if (d < status_.refused.size() && !status_.refused[d].empty())
        add(Severity::bad, "device " + device.name,
            "The broker refuses the samples of " + device.name + " with " + status_.refused[d],
            "Allow this client to publish below " + config_.base_topic() + "/" + device.name +
                " on the broker.",
            0);
    }
  }

  std::string works() const {
    std::string text = std::to_string(online_) + " of " + counted(devices_, "device") +
                       (online_ == 1 ? " answers" : " answer");
    text += status_.broker.connected ? "; the broker is connected" : "";
    const std::uint64_t waiting = status_.samples.stored + status_.samples.queued;
    if (!status_.broker.connected && waiting > 0)
      text += "; " + counted(waiting, "sample") + " wait for the broker" +
              (status_.store_state == "disk" ? " on disk" : " in memory");
    return text;
  }

  const AgentStatus& status_;
  const Config& config_;
  std::vector<Problem> problems_;
  std::size_t devices_ = 0;
  std::size_t online_ = 0;
};

}  // namespace

std::string_view to_string(Severity severity) {
  switch (severity) {
    case Severity::ok:
      return "ok";
    case Severity::warn:
      return "warn";
    case Severity::bad:
      break;
  }
  return "bad";
}

Verdict verdict_of(const AgentStatus& status) { return Examination(status).verdict(); }

}  // namespace fxagent
