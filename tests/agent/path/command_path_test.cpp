// Every result must be true, over the complete path of a command. Random JSON messages go into
// Commands with a journal, and over the links to devices that keep a ledger of their actual writes;
// the results come out as JSON. Faults strike at any exchange, time passes, and the agent stops or
// dies at any point and starts again.
//   FXAGENT_COMMANDS=200000 command_path_test     runs this many commands
//   FXAGENT_SEED=7 …                              starts with this scene and repeats it exactly
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <iostream>

#include "agent/config/loader.h"
#include "agent/log/log.h"
#include "tests/agent/path/agent_life.h"
#include "tests/agent/path/path_judge.h"
#include "tests/support/clock_by_hand.h"
#include "tests/support/effort.h"

namespace fxagent::test {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr std::array<fxsim::Protocol, kPathDevices> kProtocols{
    fxsim::Protocol::programming_port, fxsim::Protocol::computer_link, fxsim::Protocol::modbus_tcp,
    fxsim::Protocol::modbus_rtu};

int setting(const char* name, int otherwise) {
  const char* given = std::getenv(name);
  return given == nullptr ? otherwise : std::atoi(given);
}

/// One plant and some commands, over several lives of its agent.
class Scene final {
 public:
  Scene(const Config& config, std::uint32_t seed) : config_(config), fate_(seed), journal_(fate_) {
    // Makes scenes reproducible: the clock determines the times of polls and the jitter of links.
    advance_clock(seconds(1) - std::chrono::steady_clock::now().time_since_epoch() % seconds(1));
    restart_calendar();
    for (const fxsim::Protocol protocol : kProtocols) {
      owned_.push_back(std::make_unique<LedgerDevice>(protocol));
      prepare(*owned_.back(), fate_);
      devices_.push_back(owned_.back().get());
    }
    for (const DeviceConfig& device : config.devices) names_.push_back(device.name);
    commands_ = std::make_unique<RandomCommands>(
        fate_, std::vector<const LedgerDevice*>(devices_.begin(), devices_.end()));
  }

  /// Runs the scene. Returns what is wrong; empty: nothing.
  std::string play() {
    const int lives = fate_.between(0, 3);
    constexpr std::array<int, 5> kFaults{0, 10, 60, 200, 400};
    for (life_ = 0; life_ < lives; ++life_) {
      fate_.faults_in_1000 = kFaults[static_cast<std::size_t>(fate_.between(0, 4))];
      live(fate_.one_in(3) ? 0 : fate_.between(1, 150));
      // Lets the answers to the previous agent arrive before the next one starts.
      advance_clock(seconds(5));
    }
    live_to_the_end();
    return judge_.judge_all(devices_, journal_, names_);
  }

  int received = 0;
  const std::map<std::string, int>& counted() const { return judge_.counted; }
  const std::map<std::string, int>& by_reason() const { return judge_.by_reason; }
  void print(const std::string& faults) const {
    std::cerr << faults;
    for (std::size_t i = 0; i < devices_.size(); ++i)
      if (faults.find(names_[i] + ":") != std::string::npos)
        for (const std::string& line : devices_[i]->story)
          std::cerr << "  " << names_[i] << " " << line << "\n";
  }

 private:
  std::unique_ptr<AgentLife> begin(int ends_at) {
    fate_.begin_life(ends_at);
    const Polling polling = fate_.one_in(4) ? Polling::on : Polling::off;
    return std::make_unique<AgentLife>(
        config_, journal_, devices_, fate_, polling,
        [this](std::uint32_t device, const std::string& text) { judge_.published(device, text); });
  }

  void live(int ends_at) {
    const auto agent = begin(ends_at);
    agent->not_acknowledged = fate_.between(0, 5);
    for (int i = fate_.between(1, 20); i > 0 && !fate_.has_ended(); --i) {
      send_some(*agent);
      const int pause = fate_.one_in(4) ? 600 : 60;
      agent->run_for(milliseconds(fate_.between(0, pause)));
    }
    if (ends_at > 0) agent->run_for(seconds(2));
    if (!fate_.has_ended())
      agent->stop([&] {
        if (fate_.one_in(3)) send_some(*agent);
      });
    if (fate_.has_ended()) judge_.killed(life_);
  }

  /// Runs the last life without faults, until every command is finished.
  void live_to_the_end() {
    fate_.faults_in_1000 = fate_.one_in(2) ? 0 : 100;
    const auto agent = begin(0);
    for (int i = fate_.between(0, 15); i > 0; --i) {
      send_some(*agent);
      agent->run_for(milliseconds(fate_.between(0, 300)));
    }
    agent->run_until_idle();
  }

  void send_some(AgentLife& agent) {
    const bool in_conflict = fate_.one_in(25);
    agent.set_conflict(in_conflict ? "0badc0de" : "");
    if (in_conflict) judge_.conflict_began();
    for (int i = fate_.one_in(4) ? fate_.between(2, 5) : 1; i > 0 && !fate_.has_ended(); --i) {
      SentCommand sent = next();
      sent.life = life_;
      sent.sent_at = std::chrono::steady_clock::now();
      sent.in_conflict = in_conflict;
      ++received;
      judge_.received(sent);
      agent.receive(sent);
      if (!sent.id.empty() && !sent.dry_run) earlier_.push_back(std::move(sent));
    }
    agent.hand_over();
  }

  /// Returns a new command, or a used id with the same, another or an invalid message.
  SentCommand next() {
    if (earlier_.empty() || !fate_.one_in(6)) return commands_->next(path_utc_ms());
    SentCommand again =
        earlier_[static_cast<std::size_t>(fate_.between(0, static_cast<int>(earlier_.size()) - 1))];
    if (!fate_.one_in(4)) return again;
    if (fate_.one_in(2)) {
      again.payload.back() = ',';
      again.payload += R"("nonsense":1})";
      again.is_wrong = true;
      again.targets.clear();
      again.read.reset();
      again.expect.reset();
      again.op.clear();
      return again;
    }
    SentCommand other = commands_->next(path_utc_ms());
    if (other.id.empty() || other.dry_run || other.op == "run" || other.op == "stop") return other;
    nlohmann::json payload = nlohmann::json::parse(other.payload);
    payload["id"] = again.id;
    other.id = again.id;
    other.device = again.device == other.device ? again.device : other.device;
    other.payload = payload.dump();
    return other;
  }

  const Config& config_;
  Fate fate_;
  LastingJournal journal_;
  std::vector<std::unique_ptr<LedgerDevice>> owned_;
  std::vector<LedgerDevice*> devices_;
  std::vector<std::string> names_;
  std::unique_ptr<RandomCommands> commands_;
  PathJudge judge_;
  std::vector<SentCommand> earlier_;
  int life_ = 0;
};

TEST(CommandPath, EveryResultSaysWhatTheDeviceReallyDid) {
  const int wanted = setting("FXAGENT_COMMANDS", effort(10000));
  auto seed = static_cast<std::uint32_t>(setting("FXAGENT_SEED", 1));
  log::set_level(log::Level::error);
  const auto config = parse_config(plant_of_the_path());
  ASSERT_TRUE(config) << to_string(config.error().front(), "plant");
  std::map<std::string, int> counted;
  std::map<std::string, int> by_reason;
  int received = 0;
  int wrong = 0;
  for (; received < wanted && wrong < 3; ++seed) {
    Scene scene(*config, seed);
    const std::string faults = scene.play();
    received += scene.received;
    for (const auto& [status, count] : scene.counted()) counted[status] += count;
    for (const auto& [reason, count] : scene.by_reason()) by_reason[reason] += count;
    if (faults.empty()) continue;
    ++wrong;
    ADD_FAILURE() << "scene " << seed;
    scene.print(faults);
  }
  std::cout << received << " commands:";
  for (const auto& [status, count] : counted) std::cout << " " << status << " " << count;
  std::cout << "\nof which:";
  for (const auto& [reason, count] : by_reason) std::cout << " " << reason << " " << count << ",";
  std::cout << "\n";
  if (received < wanted) return;  // aborted
  // A run without one of these would prove nothing about it.
  for (const char* status :
       {"SUCCEEDED", "FAILED", "PARTIAL", "REJECTED", "EXPIRED", "DUPLICATE", "UNKNOWN_OUTCOME"})
    EXPECT_GE(counted[status], wanted / 400) << status;
  for (const char* reason : {"FAILED interrupted", "UNKNOWN_OUTCOME interrupted",
                             "REJECTED conflict", "FAILED expect_mismatch"})
    EXPECT_GE(by_reason[reason], std::max(1, wanted / 400)) << reason;
}

}  // namespace
}  // namespace fxagent::test
