#include "agent/uplink/drop_warning.h"

#include <chrono>
#include <utility>

#include "agent/log/log.h"

namespace fxagent {
namespace {

constexpr std::chrono::hours kWarnEvery{24};
constexpr std::chrono::minutes kEndedAfter{10};

/// The cause of a loss, and the remedy.
struct Explained {
  std::string reason;
  std::string note;
};

Explained explained(DropCause cause, const WaitingSamples& waiting, const GuardedStore* store) {
  switch (cause) {
    case DropCause::outbox:
      return {"samples arrived faster than the agent could store or send them",
              "use longer intervals or fewer tags, or give the agent more of the processor"};
    case DropCause::refused:
      return {"the broker or the format of the messages does not accept them",
              "see sample_refused and history_refused in the log"};
    case DropCause::memory:
      return {"the memory for samples that wait is full: " +
                  std::to_string(waiting.backlog().max_bytes()) + " bytes",
              store == nullptr ? "set store.path, so that samples wait on disk"
                               : "the disk of store.path refuses: see store in the log"};
    case DropCause::store:
      break;
  }
  const auto limit = store->figures().dropped_by;
  if (limit == StoreLimit::max_bytes)
    return {"the store is full: store.max_bytes is " + std::to_string(store->max_bytes()) +
                "; its oldest samples make room",
            "restore the connection, raise store.max_bytes, or use longer intervals"};
  if (limit == StoreLimit::max_age)
    return {"samples in the store are older than store.max_age_h",
            "restore the connection, or raise store.max_age_h"};
  return {"rows of the store are damaged, or its file was removed", "see store in the log"};
}

}  // namespace

void DropWarning::keep(SteadyTime now) {
  const std::uint64_t before = std::exchange(total_, waiting_.dropped().total());
  if (total_ != before) {
    if (!loss_) loss_ = Loss{.before = before};
    loss_->last = now;
    warn(*loss_, now);
  } else if (loss_ && session_.is_connected() && now >= loss_->last + kEndedAfter) {
    log::info("samples_dropped", {{"state", "ended"},
                                  {"count", std::to_string(total_ - loss_->before)},
                                  {"broker", broker(now)}});
    loss_.reset();
  }
}

void DropWarning::warn(Loss& loss, SteadyTime now) const {
  auto [reason, note] = explained(waiting_.dropped().last_cause(), waiting_, store_);
  const auto [warned, is_new] = loss.warned.try_emplace(reason, now);
  if (!is_new && now < warned->second + kWarnEvery) return;
  warned->second = now;
  log::warn("samples_dropped", {{"count", std::to_string(total_ - loss.before)},
                                {"reason", std::move(reason)},
                                {"broker", broker(now)},
                                {"note", std::move(note)}});
}

std::string DropWarning::broker(SteadyTime now) const {
  const std::string text = session_.log_name();
  if (session_.is_connected()) return text + " is connected";
  const SteadyTime since = session_.since();
  if (since == SteadyTime{}) return text + " has not been connected since the start";
  const auto away = std::chrono::duration_cast<std::chrono::seconds>(now - since);
  return text + " has not been connected for " + std::to_string(away.count()) + " s";
}

}  // namespace fxagent
