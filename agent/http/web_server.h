// Serves the page with its data, /metrics, /healthz and /readyz at the configured address, on its
// own thread. Reads only the status board, the kept log events and the recorder's frames, and
// passes commands on without waiting, so it cannot hold up the agent. If the address is not
// available, logs why and tries again every 5 s.
#pragma once

#include <chrono>
#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <thread>

#include "agent/config/model.h"
#include "agent/file_handle.h"
#include "agent/handover/status_board.h"
#include "agent/http/http_server.h"
#include "agent/http/page_api.h"
#include "agent/http/page_commands.h"

namespace fxagent {

class WebServer final {
 public:
  /// Time between two attempts to open the address.
  static constexpr std::chrono::seconds kRetry{5};
  /// Most files open at once: connections, and the server's own.
  static constexpr std::size_t kMostFiles = HttpServer::kMostConnections + 4;

  /// Starts the thread. `board` outlives this object. If no thread can be started, logs that and
  /// serves nothing. For the page, the agent keeps last values and log events from this call on.
  /// `place` as for PageCommands, `recorder` as for PageApi.
  WebServer(HttpConfig config, StatusBoard& board, std::function<void(RelayedCommand)> place = {},
            const FlightRecorder* recorder = nullptr);
  /// Ends the thread within kPatience.
  ~WebServer();
  WebServer(const WebServer&) = delete;
  WebServer& operator=(const WebServer&) = delete;

 private:
  /// Longest wait for a fresh status. If it runs out, requests of the next second do not wait.
  static constexpr std::chrono::milliseconds kPatience{500};

  void work();
  /// Returns null if the server does not start. `told` is the last reason that was logged.
  std::unique_ptr<HttpServer> started(std::string& told);
  void serve(HttpServer& server);
  /// Returns true when `file` is readable, when a command has its result, or at `until`. Returns
  /// false when the thread must end.
  bool wait(int file, SteadyTime until) const;

  std::optional<HttpAnswer> answer(const HttpRequest& request);
  HttpAnswer metrics();
  HttpAnswer page(const HttpRequest& request);
  std::optional<HttpAnswer> command(const HttpRequest& request);
  /// True if a browser may call the page by this Host: an address, `localhost` or a name of the
  /// config. A web site that makes its own name mean our address (DNS rebinding) is refused.
  bool is_our_name(std::string_view host) const;
  std::shared_ptr<const AgentStatus> status();

  const HttpConfig config_;
  StatusBoard& board_;
  const FileHandle end_;  ///< readable when the thread must end
  // Used by the thread only.
  SteadyTime ask_again_{};
  HttpServer* server_ = nullptr;              ///< null until it serves
  std::shared_ptr<const AgentStatus> shown_;  ///< the status that `text_` shows
  std::shared_ptr<const std::string> text_;
  PageApi api_;
  PageCommands commands_;
  std::thread thread_;
};

}  // namespace fxagent
