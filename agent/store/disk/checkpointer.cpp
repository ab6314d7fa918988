#include "agent/store/disk/checkpointer.h"

#include "agent/without_signals.h"

namespace fxagent {
namespace {

// The second pass is short; usually no commit has come since the first.
constexpr int kPasses = 2;

}  // namespace

Checkpointer::Checkpointer(SQLite::Database& writer, const std::string& path)
    : writer_(writer), own_(sqlite::open(path)) {
  // Opens the WAL now: later, other files may have replaced these.
  own_.tryExec("PRAGMA schema_version");
  const WithoutSignals quiet;
  thread_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
  // SQLiteCpp has neither this hook nor a checkpoint that reports its progress.
  sqlite3_wal_hook(writer_.getHandle(), committed, this);
}

Checkpointer::~Checkpointer() { sqlite3_wal_hook(writer_.getHandle(), nullptr, nullptr); }

/// SQLite calls this after each commit. A checkpoint's result is ignored: the pages are safe in the
/// WAL, and a later commit tries again.
int Checkpointer::committed(void* self, sqlite3* writer, const char* schema, int pages) noexcept {
  auto& checkpointer = *static_cast<Checkpointer*>(self);
  if (pages < kPages) {
    checkpointer.copied_ = 0;  // the WAL has started over
  } else if (pages >= kMostPages) {
    const std::lock_guard alone(checkpointer.working_);
    sqlite3_wal_checkpoint_v2(writer, schema, SQLITE_CHECKPOINT_PASSIVE, nullptr, nullptr);
  } else if (pages - checkpointer.copied_ >= kPages) {
    const std::lock_guard lock(checkpointer.mutex_);
    checkpointer.due_ = true;
    checkpointer.news_.notify_one();
  }
  return SQLITE_OK;
}

void Checkpointer::run(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  while (news_.wait(lock, stop, [this] { return due_; })) {
    due_ = false;
    lock.unlock();
    bring_home();
    lock.lock();
  }
}

void Checkpointer::bring_home() {
  const std::lock_guard alone(working_);
  int pages = 0;
  int home = -1;
  for (int pass = 0; pass < kPasses && home < pages; ++pass)
    if (sqlite3_wal_checkpoint_v2(own_.getHandle(), nullptr, SQLITE_CHECKPOINT_PASSIVE, &pages,
                                  &home) != SQLITE_OK)
      return;
  copied_ = home;
}

}  // namespace fxagent
