#include "agent/remote/kept_file.h"

#include <algorithm>
#include <chrono>
#include <exception>
#include <filesystem>
#include <system_error>
#include <utility>

#include "agent/log/log.h"

namespace fxagent {
namespace {

constexpr const char* kFileName = "remote_config.json";
constexpr std::chrono::seconds kSaveAgain{60};
/// If a process ends sooner without a stop, its config may be the cause.
constexpr std::chrono::hours kWatch{1};

}  // namespace

void KeptFile::open(const std::string& directory, std::string agent) {
  if (!directory.empty()) file_.emplace(directory, kFileName);
  agent_ = std::move(agent);
}

std::string KeptFile::load() {
  if (!file_) return {};
  const auto leave_out = [&](const std::string& what, const std::string& why) {
    log::error("remote_config",
               {{"note", what}, {"file", file_->path()}, {"reason", log::excerpt(why)}});
    return what + ": " + why;
  };
  const auto text = file_->read(kMaxKeptBytes);
  if (!text) return leave_out("the kept config cannot be read and is ignored", text.error());
  if (!*text) return {};
  auto kept = kept_configs_from(**text);
  if (!kept) return leave_out("the kept config is damaged and is ignored", kept.error());
  if (kept->agent == agent_)
    configs_ = std::move(*kept);
  else
    log::warn("remote_config", {{"note", "the kept config belongs to another agent and is ignored"},
                                {"file", file_->path()},
                                {"agent", log::excerpt(kept->agent)}});
  return {};
}

std::string KeptFile::judge_last_run(std::int64_t now_ms) {
  if (!configs_.judged && !configs_.trying && !configs_.watched) return {};
  is_unsaved_ = true;
  return fxagent::judge_last_run(configs_, boot_, now_ms);
}

std::string KeptFile::save() {
  is_unsaved_ = false;
  if (!file_) return "neither store.path nor systemd's STATE_DIRECTORY is set";
  configs_.agent = agent_;
  configs_.boot = boot_;
  configs_.watched = is_watched() && !configs_.trying;
  std::string why;
  try {
    why = file_->lock();
    if (why.empty()) why = configs_.empty() ? file_->remove() : file_->write(to_text(configs_));
  } catch (const std::exception& fault) {  // out of memory
    why = fault.what();
  }
  is_unsaved_ = !why.empty();
  return why;
}

void KeptFile::save_or_log(std::string_view what) {
  const std::string why = save();
  if (why.empty() || !file_) return;
  log::error("remote_config",
             {{"note", std::string(what) + " could not be saved to disk; the agent tries again. "
                                           "Until then, a restart uses the earlier record"},
              {"reason", why}});
}

void KeptFile::end_judging() {
  if (!configs_.judged) return;
  configs_.judged.reset();
  save_or_log("the end of the check");
}

void KeptFile::watch(const std::optional<KeptConfig>& in_force, SteadyTime now) {
  end_watch();
  if (!configs_.is_good(in_force)) return;
  watched_until_ = now + kWatch;
  is_unsaved_ = true;
}

void KeptFile::due(SteadyTime now) {
  if (is_unsaved_ && now >= save_again_at_) {
    save_again_at_ = now + kSaveAgain;
    save();
  }
  if (!watched_until_ || now < *watched_until_) return;
  end_watch();
  configs_.ends = 0;
  save_or_log("the proof that the config runs");
}

SteadyTime KeptFile::next_wake() const {
  const SteadyTime watched = watched_until_.value_or(SteadyTime::max());
  return is_unsaved_ ? std::min(watched, save_again_at_) : watched;
}

void KeptFile::stop() {
  if (!configs_.trying && !configs_.judged && !watched_until_ && !is_unsaved_) return;
  configs_.stopped = configs_.trying || configs_.judged;
  end_watch();
  save_or_log("the stop of the agent");
}

void KeptFile::forget() {
  configs_ = {};
  end_watch();
  const std::string why = file_ ? file_->remove() : std::string();
  if (!why.empty())
    log::warn("remote_config", {{"note", "a kept config cannot be removed"}, {"reason", why}});
}

bool KeptFile::forget_earlier_run() {
  if (!file_) return false;
  std::error_code fault;  // of a file that may be there all the same
  const auto status = std::filesystem::symlink_status(file_->path(), fault);
  if (status.type() == std::filesystem::file_type::not_found) return false;
  // Do not touch the file of another agent that runs here.
  if (const std::string why = file_->lock(); !why.empty()) {
    log::warn("remote_config", {{"note", "a kept config was not removed"}, {"reason", why}});
    return false;
  }
  forget();
  return true;
}

}  // namespace fxagent
