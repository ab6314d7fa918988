// The rings of all links, and the thread that writes them to disk at an anomaly or when asked. Only
// this thread waits for the disk. Any thread.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <stop_token>
#include <string>
#include <thread>

#include "agent/recorder/frame_ring.h"
#include "agent/recorder/recording.h"
#include "agent/recorder/recording_files.h"
#include "agent/steady_time.h"

namespace fxagent {

class FlightRecorder final {
 public:
  struct Settings {
    std::string directory{};
    std::size_t most_files = 0;
    std::uint64_t most_bytes = 0;
    std::string agent{};    ///< its id, for the files
    std::string version{};  ///< of the program
    /// Time from an anomaly to the copy, so that the file also shows what followed.
    std::chrono::milliseconds follows{1000};
    /// A link's next anomaly within this time after a file gets no file of its own.
    std::chrono::seconds rest{60};
  };

  /// Starts the thread. If the directory cannot be used, logs that and tries again at the next
  /// recording. Throws std::system_error if no thread can be started.
  explicit FlightRecorder(Settings settings);
  /// Writes every pending file without waiting for its time, then ends the thread.
  ~FlightRecorder() = default;
  FlightRecorder(const FlightRecorder&) = delete;
  FlightRecorder& operator=(const FlightRecorder&) = delete;

  /// Returns a new ring of `bytes` for the link. `wire` describes its channel. The recorder does
  /// not own it: without another owner it is gone.
  std::shared_ptr<FrameRing> new_ring(const std::string& link, std::string wire, std::size_t bytes);
  /// Returns the ring of the link; nullptr if there is none.
  std::shared_ptr<const FrameRing> ring_of(const std::string& link) const;

  /// Asks for a file of the link's frames, or adds `reason` to the file that is pending. Only
  /// counts the anomaly during `rest`, or if `most_files` files are pending. Returns at once.
  void anomaly(const std::string& link, const std::string& reason);
  /// Asks for files of the links that `fxagent record` has named. Returns at once.
  void asked();

 private:
  struct Link {
    std::weak_ptr<FrameRing> ring{};
    std::string wire{};
    SteadyTime rests_until{};   ///< no file of an anomaly before this time
    std::size_t unwritten = 0;  ///< anomalies since the last file
  };
  struct Due {
    std::shared_ptr<const FrameRing> ring{};
    std::string wire{};
    SteadyTime at{};
    std::string reason{};
  };

  void run(const std::stop_token& stop);
  void write_asked();
  std::string write(const std::string& link, const FrameRing& ring, const std::string& wire,
                    std::string reason);

  const Settings settings_;
  RecordingFiles files_;  ///< the thread's
  mutable std::mutex mutex_;
  std::condition_variable_any wake_;
  // All below are under the mutex.
  std::map<std::string, Link> links_;
  std::map<std::string, Due> due_;  ///< by link
  bool asked_ = false;
  std::jthread thread_;
};

}  // namespace fxagent
