// An agent with a remote config, without threads and with a simulated clock.
#pragma once

#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <fstream>

#include "agent/remote/remote_config.h"
#include "tests/agent/remote/remote_plant.h"
#include "tests/support/scratch.h"

namespace fxagent::test {

using namespace std::chrono_literals;

inline constexpr auto kTrial = 60s;

/// Called while a document is judged, after it was saved.
extern std::function<void()> at_judging;

/// A local file, and an agent that starts, applies configs at once, and dies.
class Plant {
 public:
  Plant() {
    local_ = local_plant();
    local_["store"]["path"] = scratch_.path("store");
    write();
    start();
  }

  json& local() { return local_; }
  void write() { std::ofstream(path()) << local_.dump(); }
  /// Changes one value of the local file.
  void set(const std::string& pointer, const json& value) {
    local_[json::json_pointer(pointer)] = value;
    write();
  }
  std::string path() const { return scratch_.path("agent.json"); }
  std::string kept_path() const { return scratch_.path("store/remote_config.json"); }

  void start(bool is_connected = true) {
    read();
    remote_->begin();
    if (is_connected) remote_->set_connected(true, steady_);
  }
  /// Runs only the part of a start that reads.
  void read() {
    remote_.emplace(path(), kTrial, boot_);
    auto config = remote_->start(now());
    ASSERT_TRUE(config.has_value()) << listed(config.error());
    in_force_ = std::move(*config);
  }
  void stop() { remote_->stop(); }
  /// Everything after this call belongs to another boot of the machine.
  void boot() { boot_ += "'"; }
  std::string store() const { return scratch_.path("store"); }
  /// Makes the disk unavailable; give_disk() makes it available again.
  void take_disk() const {
    std::filesystem::rename(store(), store() + ".away");
    std::ofstream(store()) << "no directory";
  }
  void give_disk() const {
    std::filesystem::remove(store());
    std::filesystem::rename(store() + ".away", store());
  }
  std::string kept_text() const { return content_of(kept_path()); }

  /// Returns false if nothing was applied.
  bool hear(const json& document) { return hear_text(document.dump()); }
  bool hear_text(const std::string& text) { return apply(remote_->receive(text, now())); }
  bool hang_up() {
    auto next = remote_->read_local();
    if (!next) return false;
    return apply(std::move(*next));
  }
  bool pass(SteadyTime::duration time) {
    steady_ += time;
    utc_ms_ += std::chrono::duration_cast<std::chrono::milliseconds>(time).count();
    return apply(remote_->due(now()));
  }
  void connection(bool is_up) { remote_->set_connected(is_up, steady_); }

  RemoteConfig& remote() { return *remote_; }
  const Config& in_force() const { return in_force_; }
  int retries() const { return in_force_.devices[0].retries; }
  json reported() const { return json::parse(remote_->report_text(in_force_.hash)); }
  /// Returns the reported state and version, 'applied "v1"', followed by the first error.
  std::string said() const {
    const json report = reported();
    std::string text = report["state"].get<std::string>() + " " + report["version"].dump();
    if (!report["errors"].empty()) text += ": " + report["errors"][0].get<std::string>();
    return text;
  }

  /// Receives a document, then restarts with the disk's content at the time of judging.
  void end_while_judging(const json& document) {
    std::string text;
    at_judging = [&] { text = kept_text(); };
    hear(document);
    at_judging = {};
    remote_.reset();
    std::ofstream(kept_path()) << text;
    start();
  }

  /// Receives a document, is interrupted while judging it, and starts again.
  void stop_while_judging(const json& document) {
    at_judging = [&] { remote_->interrupt(); };
    EXPECT_FALSE(hear(document));
    at_judging = {};
    stop();
    start();
  }

  /// Builds a document that sets the retries of the first device.
  json with_retries(const std::string& version, int retries) const {
    json devices = local_["devices"];
    devices[0]["retries"] = retries;
    return {{"version", version}, {"config", {{"devices", devices}}}};
  }

 private:
  RemoteConfig::Moment now() const { return {steady_, utc_ms_}; }
  bool apply(std::optional<RemoteConfig::Next> next) {
    if (!next) return false;
    in_force_ = next->config;
    remote_->accept(std::move(*next), now());
    return true;
  }

  Scratch scratch_;
  json local_;
  std::optional<RemoteConfig> remote_;
  Config in_force_;
  SteadyTime steady_{1h};
  std::int64_t utc_ms_ = 1'790'000'000'000;
  std::string boot_ = "boot";
};

}  // namespace fxagent::test
