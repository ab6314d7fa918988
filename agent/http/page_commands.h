// Commands from the page: POST /api/command. Checks who sends one and from where, and passes it to
// the agent, whose admission, journal and audit treat it as one from MQTT. The thread of the HTTP
// server.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "agent/handover/command_message.h"
#include "agent/http/http_server.h"
#include "agent/steady_time.h"

namespace fxagent {

class PageCommands final {
 public:
  /// Longest command, in bytes, with its `device`.
  static constexpr std::size_t kMostBytes = 65536;

  /// `token_file` is read for each command, so that a change needs no restart; empty: every command
  /// is refused. `place` must not block; it calls RelayedCommand::reply once, on any thread, or
  /// never if the agent is stopping.
  PageCommands(std::string token_file, std::function<void(RelayedCommand)> place);
  PageCommands(const PageCommands&) = delete;
  PageCommands& operator=(const PageCommands&) = delete;

  /// Returns the refusal. nullopt: the command is on its way, and take_results() gets its result.
  std::optional<HttpAnswer> place(const HttpRequest& request);

  struct Result {
    std::uint64_t number = 0;  ///< HttpRequest::number
    std::string text;          ///< JSON
  };
  /// Returns the results that have come since the last call.
  std::vector<Result> take_results();
  /// Readable while there are results.
  int file() const;

 private:
  struct Inbox;

  const std::string token_file_;
  const std::function<void(RelayedCommand)> place_;
  const std::shared_ptr<Inbox> inbox_;  ///< shared with the commands that wait
  SteadyTime logs_again_{};             ///< when a wrong token is logged again
};

}  // namespace fxagent
