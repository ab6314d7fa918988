// Writes log lines to a file descriptor on a separate thread, so that an unread pipe, a stopped
// terminal or a slow disk does not block callers.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <vector>

namespace fxagent::log {

/// True if the open file `handle` is the journal of systemd: JOURNAL_STREAM (systemd.exec(5)) names
/// its device and inode. False for a file that was redirected, even if the variable was inherited.
/// Any thread.
bool is_journal_stream(int handle);

class LogWriter final {
 public:
  /// Most bytes waiting; lines beyond these are dropped and counted.
  static constexpr std::size_t kMostBytes = std::size_t{256} << 10;
  /// While all lines so far were written at once, write() waits this long for its line, so that the
  /// line is out if the caller then crashes.
  static constexpr std::chrono::milliseconds kWaitForLine{2};
  static constexpr std::chrono::seconds kAskEvery{1};

  struct Callbacks {
    /// Returns the line that reports the number of dropped lines. Called on the writer's thread.
    std::function<std::string(std::uint64_t count)> dropped;
    /// Returns lines that are due without write(). Called every second on the writer's thread.
    std::function<std::vector<std::string>()> due;
  };

  /// `handle` stays open for the lifetime of the process. Throws std::system_error if no thread can
  /// be started.
  LogWriter(int handle, Callbacks callbacks);
  /// Discards what is not written. A thread that is blocked in a write is left behind.
  ~LogWriter();
  LogWriter(const LogWriter&) = delete;
  LogWriter& operator=(const LogWriter&) = delete;

  /// Writes a whole line with its line end. Any thread except the writer's.
  void write(std::string line);
  /// Writes a line that `make` returns, with its line end, on the writer's thread when the line's
  /// turn comes. Counts it as `bytes` long and does not wait for it. Drops it if the queue is half
  /// full. Any thread except the writer's.
  void write_later(std::size_t bytes, std::function<std::string()> make);
  /// Waits until all is written, for at most `patience`. False: it was not.
  bool flush(std::chrono::milliseconds patience);

 private:
  struct Line {
    std::string text;
    std::function<std::string()> make;  ///< empty: `text` is the line
    std::size_t bytes = 0;              ///< counted against kMostBytes
  };
  /// Owned by the writer and by its thread, which may outlive it.
  struct Shared {
    std::mutex mutex;
    std::condition_variable news;     ///< for the thread
    std::condition_variable written;  ///< for waiting callers
    std::deque<Line> lines;
    std::size_t bytes = 0;
    std::uint64_t dropped = 0;
    std::uint64_t taken = 0;  ///< lines ever put into the queue
    std::uint64_t done = 0;   ///< number of these that are written
    bool behind = false;      ///< a caller waited in vain, and the queue has not been empty since
    bool over = false;
  };
  /// Queues the line. False: the queue is full, and counts the line as dropped. Under the mutex.
  bool take(Line line, std::size_t room);
  static void run(const std::shared_ptr<Shared>& shared, int handle, const Callbacks& callbacks);
  static void write_all(int handle, const std::string& text);

  std::shared_ptr<Shared> shared_;
};

/// Limits equal log lines. In each period the first few are written; the rest is counted and
/// reported in one line when the period is over. Pure: time is an argument. One thread at a time.
class LogRepeats final {
 public:
  using Time = std::chrono::steady_clock::time_point;
  static constexpr std::chrono::seconds kWhile{10};
  static constexpr std::uint64_t kWritten = 5;
  /// Most texts counted at a time; lines beyond these are written.
  static constexpr std::size_t kMostTexts = 256;

  struct Repeated {
    int level = 0;
    std::string text;
    std::uint64_t count = 0;  ///< lines not written
  };

  /// True if this line is to be written; otherwise it is counted.
  bool take(Time now, int level, std::string_view text);
  /// Returns the counts of all periods that are over at `now`; at Time::max(), of all periods.
  std::vector<Repeated> over(Time now);

 private:
  struct Seen {
    Time until{};
    int level = 0;
    std::uint64_t count = 0;
  };
  std::map<std::string, Seen, std::less<>> seen_;
};

}  // namespace fxagent::log
