// What `fxagent check --online` found, as text, as JSON and as an exit status. Pure.
#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "agent/config/config.h"
#include "agent/messages.h"

namespace fxagent {

/// The process that has a link.
struct OnlineHolder {
  int pid = 0;
  std::string program;
  enum class Runs : std::uint8_t { this_config, another_config, no_agent } runs = Runs::no_agent;
};

struct OnlineLink {
  /// `held`: another process has it, so it was left alone. `unused`: it has no device.
  enum class State : std::uint8_t { open, down, held, unused };
  std::string name;
  std::string place;  ///< "/dev/ttyUSB0", "192.0.2.7:502"
  State state = State::unused;
  std::string text{};  ///< down: why, and the cure
  std::optional<OnlineHolder> holder{};
};

struct OnlineDevice {
  struct BadTag {
    std::uint32_t tag = 0;  ///< index in DeviceConfig::tags
    BadReason reason = BadReason::timeout;
  };
  enum class State : std::uint8_t { answers, silent, not_asked, broadcast };
  State state = State::not_asked;
  std::string reason{};  ///< silent: the word of the device's state; answers: degraded by it
  std::string text{};    ///< `reason` for a person: what to check
  std::string model{};
  std::string model_configured{};  ///< the config's model, when the device is another one
  std::optional<bool> run{};
  std::size_t good = 0;  ///< tags that were read
  std::vector<BadTag> bad{};
};

struct OnlineBroker {
  std::string server;
  bool connected = false;
  std::string text{};  ///< why it did not connect, or what it refuses; empty: all is well
};

/// Collects what the devices of a config answer. Each asked device is expected to say its state and
/// one sample for each of its groups.
class OnlineDevices final {
 public:
  /// `config` outlives it. No device is asked yet.
  explicit OnlineDevices(const Config& config);

  /// The device is asked, or asked again: what it said before is forgotten.
  void ask(std::uint32_t device);
  void take(const DeviceStatus& status);
  void take(const Telemetry& sample);
  /// True when each asked device has answered or is known to be silent.
  bool settled() const;
  /// Devices on open links that left a question unanswered or answered it with damaged frames. One
  /// lost answer says little.
  std::vector<std::uint32_t> worth_another_try() const;

  /// By index in Config::devices.
  const std::vector<OnlineDevice>& found() const { return found_; }

 private:
  struct Awaited {
    bool status = false;              ///< its first word is to come
    std::set<std::uint32_t> samples;  ///< of these groups
  };
  const Config* config_;
  std::vector<OnlineDevice> found_;
  std::vector<Awaited> awaited_;
};

struct OnlineFindings {
  std::string path;                   ///< of the config
  std::vector<OnlineLink> links;      ///< by index in Config::links
  std::vector<OnlineDevice> devices;  ///< by index in Config::devices
  std::vector<OnlineBroker> brokers;
  std::string command_id;  ///< a new one, for the command that is offered
};

/// Sets the state of each link that is neither held nor unused by what its devices say.
void judge_links(const Config& config, OnlineFindings& findings);

/// 0: everything answers, as the config says. 1: a link, a device or a broker does not answer. 3:
/// else, a link was left alone because another process has it. 4: else, something answers, and not
/// as the config says.
int exit_status(const OnlineFindings& findings);

/// A line for each link, device and broker; then what to do.
std::string online_text(const Config& config, const OnlineFindings& findings);
std::string online_json(const Config& config, const OnlineFindings& findings);

}  // namespace fxagent
