// The audit of commands that come from the command line. Each has its record on disk before its
// first byte leaves, and its result after it, in the audit of the agent whose config it is. An
// agent that runs has the store to itself: then there is no audit here, and nothing is to be sent.
#pragma once

#include <cstdint>
#include <string>

#include "agent/config/config.h"
#include "agent/messages.h"
#include "agent/store/audit_trail.h"
#include "agent/store/store_disk.h"

namespace fxagent {

/// "cli:" and the name of the user who logged in, which sudo does not change. Without a login the
/// user of the process.
std::string command_line_user();

class CommandLineAudit final {
 public:
  /// Opens the store, which stays this process's until the end of the object.
  CommandLineAudit(const StoreConfig& config, std::int64_t utc_ms);
  CommandLineAudit(const CommandLineAudit&) = delete;
  CommandLineAudit& operator=(const CommandLineAudit&) = delete;

  /// The reason why the audit takes no record, and the cure; empty: it takes them.
  std::string fault() const;

  /// Notes the command before it is sent. `text` is the call. False: the note is not on disk,
  /// fault() says why, and the command must not be sent.
  bool admitted(const Command& command, const std::string& device, const std::string& text);
  /// Notes its result. False: as above, and the command was carried out.
  bool finished(const CommandResult& result, const std::string& device, std::int64_t utc_ms);
  /// Notes a command that was not sent, and why.
  bool refused(const Command& command, const CommandResult& result, const std::string& device,
               const std::string& text);

 private:
  bool write(const std::string& body);

  const StoreConfig config_;
  StoreDisk disk_;
  AuditTrail audit_;
  std::uint64_t number_ = 0;  ///< of the command
};

}  // namespace fxagent
