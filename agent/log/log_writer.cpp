#include "agent/log/log_writer.h"

#include <poll.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <thread>
#include <utility>

#include "agent/without_signals.h"

namespace fxagent::log {

bool is_journal_stream(int handle) {
  // The environment does not change while the agent runs.
  const char* named = std::getenv("JOURNAL_STREAM");  // NOLINT(concurrency-mt-unsafe)
  struct stat file {};
  if (named == nullptr || ::fstat(handle, &file) != 0) return false;
  return named == std::to_string(file.st_dev) + ":" + std::to_string(file.st_ino);
}

LogWriter::LogWriter(int handle, Callbacks callbacks) : shared_(std::make_shared<Shared>()) {
  const WithoutSignals quiet;
  std::thread([shared = shared_, handle, moved = std::move(callbacks)] {
    run(shared, handle, moved);
  }).detach();
}

LogWriter::~LogWriter() {
  const std::lock_guard lock(shared_->mutex);
  shared_->over = true;
  shared_->news.notify_one();
}

void LogWriter::write(std::string line) {
  const std::size_t bytes = line.size();
  std::unique_lock lock(shared_->mutex);
  if (!take({std::move(line), {}, bytes}, kMostBytes)) return;
  const std::uint64_t own = shared_->taken;
  if (shared_->behind) return;
  shared_->behind =
      !shared_->written.wait_for(lock, kWaitForLine, [&] { return shared_->done >= own; });
}

void LogWriter::write_later(std::size_t bytes, std::function<std::string()> make) {
  const std::lock_guard lock(shared_->mutex);
  take({{}, std::move(make), bytes}, kMostBytes / 2);
}

bool LogWriter::take(Line line, std::size_t room) {
  if (shared_->bytes + line.bytes > room) {
    ++shared_->dropped;
    return false;
  }
  shared_->bytes += line.bytes;
  shared_->lines.push_back(std::move(line));
  ++shared_->taken;
  shared_->news.notify_one();
  return true;
}

bool LogWriter::flush(std::chrono::milliseconds patience) {
  std::unique_lock lock(shared_->mutex);
  return shared_->written.wait_for(
      lock, patience, [&] { return shared_->done == shared_->taken && shared_->dropped == 0; });
}

void LogWriter::run(const std::shared_ptr<Shared>& shared, int handle, const Callbacks& callbacks) {
  auto ask_at = std::chrono::steady_clock::now() + kAskEvery;
  std::unique_lock lock(shared->mutex);
  while (!shared->over) {
    if (!shared->lines.empty()) {
      const Line line = std::move(shared->lines.front());
      shared->lines.pop_front();
      lock.unlock();
      write_all(handle, line.make ? line.make() : line.text);
      lock.lock();
      shared->bytes -= line.bytes;
      ++shared->done;
    } else if (const std::uint64_t count = std::exchange(shared->dropped, 0); count != 0) {
      lock.unlock();
      write_all(handle, callbacks.dropped(count));
      lock.lock();
    } else if (std::chrono::steady_clock::now() >= ask_at) {
      ask_at = std::chrono::steady_clock::now() + kAskEvery;
      lock.unlock();
      for (const std::string& line : callbacks.due()) write_all(handle, line);
      lock.lock();
    } else {
      shared->behind = false;
      shared->written.notify_all();
      shared->news.wait_until(lock, ask_at);
    }
  }
}

/// Discards the rest after an error: the reader may be gone for good.
void LogWriter::write_all(int handle, const std::string& text) {
  for (std::size_t at = 0; at < text.size();) {
    const ssize_t count = ::write(handle, text.data() + at, text.size() - at);
    if (count >= 0) {
      at += static_cast<std::size_t>(count);
    } else if (errno == EAGAIN) {  // another process has made it non-blocking
      pollfd room{handle, POLLOUT, 0};
      ::poll(&room, 1, -1);
    } else if (errno != EINTR) {
      return;
    }
  }
}

bool LogRepeats::take(Time now, int level, std::string_view text) {
  auto found = seen_.find(text);
  if (found == seen_.end()) {
    if (seen_.size() >= kMostTexts)
      std::erase_if(seen_, [&](const auto& entry) {
        return entry.second.until <= now && entry.second.count <= kWritten;
      });
    if (seen_.size() >= kMostTexts) return true;
    found = seen_.emplace(text, Seen{now + kWhile, level, 0}).first;
  }
  Seen& seen = found->second;
  // A period that is over and has a count to report ends with over().
  if (seen.until <= now && seen.count <= kWritten) seen = {now + kWhile, level, 0};
  return ++seen.count <= kWritten;
}

std::vector<LogRepeats::Repeated> LogRepeats::over(Time now) {
  std::vector<Repeated> told;
  std::erase_if(seen_, [&](const auto& entry) {
    const auto& [text, seen] = entry;
    if (seen.until > now) return false;
    if (seen.count > kWritten) told.push_back({seen.level, text, seen.count - kWritten});
    return true;
  });
  return told;
}

}  // namespace fxagent::log
