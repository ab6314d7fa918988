// Writes log lines to a file descriptor, on a thread of its own: a pipe that nobody reads, a
// terminal that was stopped or a slow disk holds up nobody who logs.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

namespace fxagent::log {

class LogWriter final {
 public:
  /// What waits beyond this is dropped and counted.
  static constexpr std::size_t kMostBytes = std::size_t{256} << 10;
  /// While all has been written at once so far, a line is waited for that long, so that it is out
  /// when its writer dies of what it has just told.
  static constexpr std::chrono::milliseconds kWaitForLine{2};
  static constexpr std::chrono::seconds kAskEvery{1};

  struct Callbacks {
    /// The line that tells how many were dropped. The writer's thread.
    std::function<std::string(std::uint64_t count)> dropped;
    /// Lines that are due without anybody logging; asked for every second. The writer's thread.
    std::function<std::vector<std::string>()> due;
  };

  /// `handle` stays open for as long as the process lives. Throws std::system_error where there is
  /// no thread.
  LogWriter(int handle, Callbacks callbacks);
  /// Gives up what is not written. A thread that stands in a write is left behind.
  ~LogWriter();
  LogWriter(const LogWriter&) = delete;
  LogWriter& operator=(const LogWriter&) = delete;

  /// A whole line with its end. Any thread but the writer's.
  void write(std::string line);
  /// A line that `make` makes, with its end, on the writer's thread, when its turn comes. It is
  /// taken for `bytes` long and not waited for; where the queue is half full it is dropped. Any
  /// thread but the writer's.
  void write_later(std::size_t bytes, std::function<std::string()> make);
  /// Waits until all is written, at most so long. False: it was not.
  bool flush(std::chrono::milliseconds patience);

 private:
  struct Line {
    std::string text;
    std::function<std::string()> make;  ///< empty: `text` is the line
    std::size_t bytes = 0;              ///< as it counts for kMostBytes
  };
  /// Belongs to the writer and to its thread, which may outlive it.
  struct Shared {
    std::mutex mutex;
    std::condition_variable news;     ///< for the thread
    std::condition_variable written;  ///< for those who wait
    std::deque<Line> lines;
    std::size_t bytes = 0;
    std::uint64_t dropped = 0;
    std::uint64_t taken = 0;  ///< lines ever put into the queue
    std::uint64_t done = 0;   ///< of these, those that are written
    bool behind = false;      ///< a line was waited for in vain, and the queue is not empty since
    bool over = false;
  };
  /// False: there is no room for it, and it is counted. Under the mutex.
  bool take(Line line, std::size_t room);
  static void run(const std::shared_ptr<Shared>& shared, int handle, const Callbacks& callbacks);
  static void write_all(int handle, const std::string& text);

  std::shared_ptr<Shared> shared_;
};

}  // namespace fxagent::log
