// Serves /metrics, /healthz and /readyz at the configured address, on its own thread. Reads only
// the status board, so it cannot hold up the agent. If the address is not available, logs why and
// tries again every 5 s.
#pragma once

#include <chrono>
#include <cstddef>
#include <memory>
#include <string>
#include <string_view>
#include <thread>

#include "agent/config/model.h"
#include "agent/http/http_server.h"
#include "agent/status_board.h"

namespace fxagent {

class MetricsServer final {
 public:
  /// Time between two attempts to open the address.
  static constexpr std::chrono::seconds kRetry{5};
  /// Most files open at once: connections, and the server's own.
  static constexpr std::size_t kMostFiles = HttpServer::kMostConnections + 4;

  /// Starts the thread. `board` outlives this object. If no thread can be started, logs that and
  /// serves nothing.
  MetricsServer(MetricsConfig config, StatusBoard& board);
  /// Ends the thread within kPatience.
  ~MetricsServer();
  MetricsServer(const MetricsServer&) = delete;
  MetricsServer& operator=(const MetricsServer&) = delete;

 private:
  /// Longest wait for a fresh status. If it runs out, requests of the next second do not wait.
  static constexpr std::chrono::milliseconds kPatience{500};

  void work();
  /// Returns null if the server does not start. `told` is the last reason that was logged.
  std::unique_ptr<HttpServer> started(std::string& told);
  void serve(HttpServer& server);
  /// Returns true when `file` is readable, or at `until`. Returns false when the thread must end.
  bool wait(int file, SteadyTime until) const;

  HttpAnswer answer(std::string_view path);
  HttpAnswer metrics();
  std::shared_ptr<const AgentStatus> status();

  const MetricsConfig config_;
  StatusBoard& board_;
  const int end_;  ///< readable when the thread must end
  // Used by the thread only.
  SteadyTime ask_again_{};
  const HttpServer* server_ = nullptr;        ///< null until it serves
  std::shared_ptr<const AgentStatus> shown_;  ///< the status that `text_` shows
  std::shared_ptr<const std::string> text_;
  std::thread thread_;
};

}  // namespace fxagent
