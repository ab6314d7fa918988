// The data of the page: /api/config, /api/plan, /api/frames and /api/changes, made from successive
// statuses of the agent. The interface belongs to the page of the same version; it is not for other
// programs. The thread of the HTTP server.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "agent/handover/status.h"
#include "agent/http/http_server.h"
#include "agent/recorder/flight_recorder.h"

namespace fxagent {

class PageApi final {
 public:
  /// Most groups and events in one answer.
  static constexpr std::size_t kMostGroups = 200;
  static constexpr std::size_t kMostEvents = 300;

  /// `recorder` outlives it; nullptr: it is off.
  explicit PageApi(const FlightRecorder* recorder = nullptr) : recorder_(recorder) {}

  /// Answers a request for a path below /api/, from `status`, which is not null. 404 if there is no
  /// such path, 400 if an argument is wrong.
  HttpAnswer answer(const HttpRequest& request, std::shared_ptr<const AgentStatus> status);

 private:
  /// Numbers of the snapshot in which a part last changed. Snapshots are counted from 1.
  struct Changed {
    std::vector<std::uint64_t> devices;
    std::vector<std::vector<std::uint64_t>> groups;
  };
  struct Asked;

  void take(std::shared_ptr<const AgentStatus> status);
  HttpAnswer config(const HttpRequest& request);
  HttpAnswer frames(const std::string& link, std::uint64_t since) const;
  HttpAnswer changes(const Asked& asked) const;

  const FlightRecorder* const recorder_;
  std::shared_ptr<const AgentStatus> status_;
  std::uint64_t snapshot_ = 0;
  Changed changed_;
  std::int64_t dropped_ms_ = 0;  ///< when a status first had more dropped samples; 0: never
  std::string overview_;         ///< members of /api/changes that are the same for all pages
  std::shared_ptr<const std::string> config_text_;  ///< of /api/config; null: not asked for yet
};

}  // namespace fxagent
