#include "agent/store/disk/disk_guard.h"

#include "agent/log/log.h"

namespace fxagent {

bool DiskGuard::run(Work work, std::function<void()> late) {
  before_();
  if (thread_.run(std::move(work))) return true;
  hangs_ = true;
  late_ = std::move(late);
  log::error("store", {{"state", "hangs"},
                       {"path", path_},
                       {"note",
                        "the disk does not respond: until it does, samples wait in memory and the "
                        "agent refuses commands that write"}});
  return false;
}

void DiskGuard::resume(std::string_view state) {
  hangs_ = false;
  log::info("store", {{"state", std::string(state)}, {"note", "the disk responds again"}});
  if (const auto late = std::exchange(late_, {})) late();
}

}  // namespace fxagent
