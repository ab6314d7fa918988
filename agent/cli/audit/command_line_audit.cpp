#include "agent/cli/audit/command_line_audit.h"

#include <pwd.h>
#include <sys/stat.h>
#include <unistd.h>

#include <fstream>
#include <utility>

#include "agent/commands/result.h"
#include "agent/store/journal/unrecorded_file.h"

namespace fxagent {
namespace {

std::string name_of_user(uid_t user) {
  const passwd* found = ::getpwuid(user);
  return found == nullptr ? std::to_string(user) : found->pw_name;
}

/// Returns "cli:" and the login name of the user, which sudo does not change. Without a login, the
/// name of the process's user.
std::string command_line_user() {
  // The kernel preserves the login uid through sudo and su. All bits set: no login.
  uid_t user = static_cast<uid_t>(-1);
  std::ifstream("/proc/self/loginuid") >> user;
  return "cli:" + name_of_user(user == static_cast<uid_t>(-1) ? ::getuid() : user);
}

}  // namespace

CommandLineAudit::CommandLineAudit(const StoreConfig& config, std::int64_t utc_ms,
                                   std::string device, std::string call)
    : config_(config),
      device_(std::move(device)),
      call_(std::move(call)),
      disk_(config, utc_ms, StoreDisk::Failures::returned),
      audit_(config, disk_) {
  disk_.set_parts({&audit_});
  disk_.open();
  if (!disk_.is_writable()) return;
  // Commands that an agent received while the disk refused them have numbers, too.
  for (const JournalEntry& entry : UnrecordedFile::entries_in(config.path))
    audit_.count_above(entry.number);
}

std::string CommandLineAudit::fault() const {
  if (disk_.is_writable()) return {};
  std::string text = "store.path: the audit must record every command that writes, and ";
  if (disk_.is_in_use())
    return text + config_.path +
           " is in use by a running agent: send the command over MQTT or from the page, or stop "
           "the agent first";
  text += "the store cannot be written: " + disk_.last_failure();
  struct stat found {};
  if (::stat(config_.path.c_str(), &found) == 0 && found.st_uid != ::geteuid())
    return text + "; run this as the user of the store: sudo -u " + name_of_user(found.st_uid) +
           " fxagent …";
  return text;
}

bool CommandLineAudit::admitted(const Command& command) {
  return write(
      audit::admitted(new_receipt(command), command.id, command.op_text, command.received_ms));
}

bool CommandLineAudit::finished(const CommandResult& result, std::int64_t utc_ms) {
  return write(audit::result(number_, device_, result_text(result), result.frames, utc_ms));
}

bool CommandLineAudit::refused(const Command& command, const CommandResult& result) {
  return write(audit::answered(new_receipt(command), result_text(result), command.received_ms));
}

audit::Receipt CommandLineAudit::new_receipt(const Command& command) {
  number_ = audit_.next_command_number();
  return {.number = number_,
          .device = device_,
          .topic = std::string(audit::kCommandLine),
          .payload = call_,
          .payload_bytes = call_.size(),
          .by = command_line_user(),
          .received_ms = command.received_ms};
}

/// Syncs to disk: a power cut must not erase who did what.
bool CommandLineAudit::write(const std::string& body) {
  return disk_.commit("audit", StoreDisk::Sync::full, [&] { audit_.append(body); });
}

}  // namespace fxagent
