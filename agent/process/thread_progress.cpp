#include "agent/process/thread_progress.h"

#include <filesystem>
#include <fstream>
#include <optional>
#include <string_view>
#include <system_error>
#include <utility>

#include "agent/log/log.h"
#include "agent/text/text.h"

namespace fxagent {
namespace {

struct Thread {
  std::string name;
  std::uint64_t switches = 0;  ///< proc(5): voluntary and forced
};

/// Returns nullopt if the thread has ended or has another name.
std::optional<Thread> thread_at(const std::filesystem::path& task, std::string_view prefix) {
  Thread thread;
  std::ifstream comm(task / "comm");
  if (!std::getline(comm, thread.name) || !thread.name.starts_with(prefix)) return std::nullopt;
  std::ifstream status(task / "status");
  int counts = 0;
  for (std::string line; std::getline(status, line);) {
    // The forced ones are nonvoluntary_ctxt_switches.
    if (line.find("voluntary_ctxt_switches:") == line.npos) continue;
    const std::string_view number = std::string_view(line).substr(line.find(':') + 1);
    thread.switches += number_from<std::uint64_t>(trimmed(number)).value_or(0);
    ++counts;
  }
  if (counts != 2) return std::nullopt;
  return thread;
}

}  // namespace

bool ThreadProgress::check(Time now, bool excused) {
  if (now < check_at_) return hanging_thread_.empty();
  check_at_ = now + kBetweenChecks;
  const bool was_well = std::exchange(hanging_thread_, {}).empty();
  const auto before = std::exchange(seen_, {});
  std::error_code fault;
  const std::filesystem::directory_iterator tasks("/proc/self/task", fault);
  if (fault || excused) return true;
  for (const auto& task : tasks) {
    const auto thread = thread_at(task.path(), prefix_);
    if (!thread) continue;
    const std::string id = task.path().filename();
    Seen seen{thread->switches, 0};
    const auto known = before.find(id);
    if (known != before.end() && known->second.switches == seen.switches)
      seen.checks = known->second.checks + 1;
    if (seen.checks >= kChecks) hanging_thread_ = thread->name;
    seen_.emplace(id, seen);
  }
  if (was_well && !hanging_thread_.empty())
    log::error("watchdog", {{"stands_still", part_},
                            {"thread", hanging_thread_},
                            {"note", "this thread has not run for 2 min"}});
  return hanging_thread_.empty();
}

}  // namespace fxagent
