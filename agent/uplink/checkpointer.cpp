#include "agent/uplink/checkpointer.h"

namespace fxagent {

Checkpointer::Checkpointer(sqlite::Database& writer, const std::string& path)
    : writer_(writer), own_(path), thread_([this](std::stop_token stop) { run(stop); }) {
  sqlite3_wal_hook(writer_.handle(), committed, this);
}

Checkpointer::~Checkpointer() {
  sqlite3_wal_hook(writer_.handle(), nullptr, nullptr);
  thread_.request_stop();
  thread_.join();
}

/// SQLite calls this after each commit. What a checkpoint says is nobody's: the pages are safe in
/// the log, and the next commit asks again.
int Checkpointer::committed(void* self, sqlite3* writer, const char* schema, int pages) {
  auto& checkpointer = *static_cast<Checkpointer*>(self);
  if (pages >= kMostPages) {
    const std::lock_guard alone(checkpointer.working_);
    sqlite3_wal_checkpoint_v2(writer, schema, SQLITE_CHECKPOINT_PASSIVE, nullptr, nullptr);
  } else if (pages >= kPages) {
    {
      const std::lock_guard lock(checkpointer.mutex_);
      checkpointer.due_ = true;
    }
    checkpointer.news_.notify_one();
  }
  return SQLITE_OK;
}

void Checkpointer::run(std::stop_token stop) {
  std::unique_lock lock(mutex_);
  while (news_.wait(lock, stop, [this] { return due_; })) {
    due_ = false;
    lock.unlock();
    if (own_.is_open()) {
      const std::lock_guard alone(working_);
      own_.number("PRAGMA schema_version");  // finds out that there is a log
      sqlite3_wal_checkpoint_v2(own_.handle(), nullptr, SQLITE_CHECKPOINT_PASSIVE, nullptr,
                                nullptr);
    }
    lock.lock();
  }
}

}  // namespace fxagent
