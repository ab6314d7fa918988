// Audit of commands sent from the command line. Records each command on disk before its first byte
// leaves, and its result afterwards, in the audit of the agent that uses the same config. A running
// agent owns the store exclusively; then no record can be written and no command may be sent.
#pragma once

#include <cstdint>
#include <string>

#include "agent/config/model.h"
#include "agent/handover/command_message.h"
#include "agent/store/audit_trail.h"
#include "agent/store/disk/store_disk.h"

namespace fxagent {

class CommandLineAudit final {
 public:
  /// Opens the store and keeps it locked for the lifetime of the object.
  CommandLineAudit(const StoreConfig& config, std::int64_t utc_ms);
  CommandLineAudit(const CommandLineAudit&) = delete;
  CommandLineAudit& operator=(const CommandLineAudit&) = delete;

  /// Returns why the audit takes no record, and the remedy; empty if it does.
  std::string fault() const;

  /// Records the command before it is sent. `text` is the call. Returns false if the record is not
  /// on disk (see fault()); then the command must not be sent.
  bool admitted(const Command& command, const std::string& device, const std::string& text);
  /// Records the result. Returns false if the record is not on disk; the command was still
  /// executed.
  bool finished(const CommandResult& result, const std::string& device, std::int64_t utc_ms);
  /// Records a command that was not sent, with the reason.
  bool refused(const Command& command, const CommandResult& result, const std::string& device,
               const std::string& text);

 private:
  bool write(const std::string& body);

  const StoreConfig config_;
  StoreDisk disk_;
  AuditTrail audit_;
  std::uint64_t number_ = 0;  ///< number of the command
};

}  // namespace fxagent
