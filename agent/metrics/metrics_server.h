// Serves /metrics, /healthz and /readyz at the address of the config, on a thread of its own. It
// reads the status board and nothing else, so it can stop nothing. Where the address cannot be had
// it says so, and tries again.
#pragma once

#include <chrono>
#include <cstddef>
#include <memory>
#include <string>
#include <string_view>
#include <thread>

#include "agent/config/config.h"
#include "agent/metrics/http_server.h"
#include "agent/status_board.h"

namespace fxagent {

class MetricsServer final {
 public:
  /// Between two attempts to have the address.
  static constexpr std::chrono::seconds kRetry{5};
  /// Open at once: its connections, and what it has itself.
  static constexpr std::size_t kMostFiles = HttpServer::kMostConnections + 4;

  /// Starts the thread. `board` outlives it. Where there is no thread, that is logged and nothing
  /// is served.
  MetricsServer(MetricsConfig config, StatusBoard& board);
  /// Ends it within kPatience.
  ~MetricsServer();
  MetricsServer(const MetricsServer&) = delete;
  MetricsServer& operator=(const MetricsServer&) = delete;

 private:
  /// For a status of this second; an uplink that is slower is asked again a second later.
  static constexpr std::chrono::milliseconds kPatience{500};

  void work();
  /// Null where there is none; `told` is the last reason that was logged.
  std::unique_ptr<HttpServer> started(std::string& told);
  void serve(HttpServer& server);
  /// Returns when `file` can be read, at `until`, or when it is to end: then false.
  bool wait(int file, SteadyTime until) const;

  HttpAnswer answer(std::string_view path);
  HttpAnswer metrics();
  std::shared_ptr<const AgentStatus> status();

  const MetricsConfig config_;
  StatusBoard& board_;
  const int end_;  ///< can be read when the thread is to end
  // The thread's own.
  SteadyTime ask_again_{};
  const HttpServer* server_ = nullptr;        ///< null until it serves
  std::shared_ptr<const AgentStatus> shown_;  ///< whose text `text_` is
  std::shared_ptr<const std::string> text_;
  std::thread thread_;
};

}  // namespace fxagent
