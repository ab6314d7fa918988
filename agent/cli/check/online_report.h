// Findings of `fxagent check --online` as text, as JSON and as an exit status. Pure.
#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "agent/config/model.h"
#include "agent/handover/telemetry.h"

namespace fxagent {

/// Process that holds a link.
struct OnlineHolder {
  int pid = 0;
  std::string program;
  enum class Runs : std::uint8_t { this_config, another_config, no_agent } runs = Runs::no_agent;
  std::string request{};  ///< how to have it read a tag over MQTT; empty: it is not this agent
};

struct OnlineLink {
  /// `held`: another process has the link, so the check skipped it. `unused`: it has no device.
  enum class State : std::uint8_t { open, down, held, unused };
  std::string name;
  std::string place;  ///< "/dev/ttyUSB0", "192.0.2.7:502"
  State state = State::unused;
  std::string text{};  ///< down: cause and remedy
  std::optional<OnlineHolder> holder{};
};

struct OnlineDevice {
  struct BadTag {
    std::uint32_t tag = 0;  ///< index in DeviceConfig::tags
    BadReason reason = BadReason::timeout;
  };
  struct Hint {
    std::uint32_t tag = 0;  ///< index in DeviceConfig::tags
    std::string text;
  };
  enum class State : std::uint8_t { answers, silent, not_asked, broadcast };
  State state = State::not_asked;
  std::string reason{};  ///< silent: the reason word of the device state; answers: reason of a
                         ///< degraded state
  std::string text{};    ///< human-readable `reason`: what to check
  std::string model{};
  std::string model_configured{};  ///< the model in the config, if the device is a different one
  std::optional<bool> run{};
  std::size_t good = 0;  ///< number of tags read successfully
  std::vector<BadTag> bad{};
  std::vector<Hint> hints{};  ///< good floats that are absurd, and plain in another word order

  const std::string& text_or_reason() const { return text.empty() ? reason : text; }
};

struct OnlineBroker {
  std::string server;
  bool connected = false;
  std::string text{};  ///< why there is no connection, or no longer; empty: no fault
  /// Rights that the agent's user lacks, with the broker's reason:
  /// "subscribe to fx/edge7/+/command (Not authorized)".
  std::vector<std::string> refused{};
  bool is_publishing_tried = false;  ///< a response; false: `refused` can name only subscriptions
  bool sends_commands = true;        ///< the agent receives commands from it
};

/// Collects the answers of a config's devices. Expects from each queried device its state and one
/// sample for each of its groups.
class OnlineDevices final {
 public:
  /// `config` must outlive this object. Initially no device is queried.
  explicit OnlineDevices(const Config& config);

  /// Marks the device as queried, and discards its earlier answers.
  void ask(std::uint32_t device);
  void take(const DeviceStatus& status);
  void take(const Telemetry& sample);
  /// True when each queried device has answered or is known to be silent.
  bool settled() const;
  /// Returns the devices on open links with a timeout or a damaged frame. A single lost answer
  /// proves little.
  std::vector<std::uint32_t> worth_another_try() const;

  /// Returns the findings, indexed as Config::devices.
  const std::vector<OnlineDevice>& found() const { return found_; }

 private:
  struct Awaited {
    bool status = false;              ///< the first state is outstanding
    std::set<std::uint32_t> samples;  ///< groups whose sample is outstanding
  };
  const Config* config_;
  std::vector<OnlineDevice> found_;
  std::vector<Awaited> awaited_;
};

struct OnlineFindings {
  std::string path;                   ///< file of the config
  std::vector<OnlineLink> links;      ///< indexed as Config::links
  std::vector<OnlineDevice> devices;  ///< indexed as Config::devices
  std::vector<OnlineBroker> brokers;
};

/// Returns text with the command that has the agent of `config` read a tag of a device on this
/// link. `id` is a new command id. Empty: no device is on the link.
std::string request_to(const Config& config, std::size_t link, const std::string& id);

/// Derives the state of each link that is neither held nor unused from its devices.
void judge_links(const Config& config, OnlineFindings& findings);

/// Returns 0 if everything answers as the config says. Otherwise the first that applies: 1 if a
/// link, device or broker does not answer; 3 if a link was skipped because another process holds
/// it; 4 if an answer differs from the config.
int exit_status(const OnlineFindings& findings);

/// Returns a line for each link, device and broker, followed by recommended actions.
std::string online_text(const Config& config, const OnlineFindings& findings);
std::string online_json(const Config& config, const OnlineFindings& findings);

}  // namespace fxagent
