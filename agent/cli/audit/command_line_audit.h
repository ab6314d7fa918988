// Audit of commands sent from the command line. Records each command on disk before its first byte
// leaves, and its result afterwards, in the audit of the agent that uses the same config. A running
// agent owns the store exclusively; then no record can be written and no command may be sent.
#pragma once

#include <cstdint>
#include <string>

#include "agent/commands/audit_records.h"
#include "agent/config/model.h"
#include "agent/handover/command_message.h"
#include "agent/store/audit_trail.h"
#include "agent/store/disk/store_disk.h"

namespace fxagent {

class CommandLineAudit final {
 public:
  /// Opens the store and keeps it locked for the lifetime of the object. Records commands to
  /// `device`; `call` is the command line as typed.
  CommandLineAudit(const StoreConfig& config, std::int64_t utc_ms, std::string device,
                   std::string call);
  CommandLineAudit(const CommandLineAudit&) = delete;
  CommandLineAudit& operator=(const CommandLineAudit&) = delete;

  /// Returns why the audit takes no record, and the remedy; empty if it does.
  std::string fault() const;

  /// Records the command before it is sent. Returns false if the record is not on disk (see
  /// fault()); then the command must not be sent.
  bool admitted(const Command& command);
  /// Records the result. False: the record is not on disk; the command was still executed.
  bool finished(const CommandResult& result, std::int64_t utc_ms);
  /// Records a command that was not sent, with the reason.
  bool refused(const Command& command, const CommandResult& result);

 private:
  /// Takes the next command number.
  audit::Receipt new_receipt(const Command& command);
  bool write(const std::string& body);

  const StoreConfig config_;
  const std::string device_;
  const std::string call_;
  StoreDisk disk_;
  AuditTrail audit_;
  std::uint64_t number_ = 0;  ///< number of the command
};

}  // namespace fxagent
