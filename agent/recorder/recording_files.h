// The directory of recordings: bounded in number and bytes, the oldest file goes first. Also the
// way in which `fxagent record` finds the agent that writes there and gets its answer. One thread.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "agent/file_handle.h"

namespace fxagent {

class RecordingFiles final {
 public:
  /// Does not touch the disk. `most_files` and `most_bytes` bound the recordings.
  RecordingFiles(std::string directory, std::size_t most_files, std::uint64_t most_bytes);
  RecordingFiles(const RecordingFiles&) = delete;
  RecordingFiles& operator=(const RecordingFiles&) = delete;

  /// Creates the directory (0700) and locks it, so that writer_of() finds this process. Returns
  /// empty on success, else the reason.
  std::string begin();

  /// Calls begin() if it has not succeeded. Makes room, then writes the text to a new file (0600),
  /// whose name is made of time and link. Afterwards the directory is within its bounds. Returns
  /// empty and sets `path`, or returns the reason.
  std::string write(std::string_view link, std::int64_t written_us, std::string_view text,
                    std::string& path);

  /// Returns and removes the names of links that `fxagent record` left; empty: all links.
  std::vector<std::string> take_request();
  /// Reports the files written for a request. Returns empty on success, else the reason.
  std::string answer(std::int64_t now_us, const std::vector<std::string>& paths);

 private:
  /// Deletes the oldest recordings until `bytes` more fit. Those with a later time than `time`, of
  /// a clock that was ahead, go first.
  std::string make_room(std::uint64_t bytes, const std::string& time) const;

  const std::string directory_;
  const std::size_t most_files_;
  const std::uint64_t most_bytes_;
  FileHandle lock_;
};

/// Last part of the name of a recording.
inline constexpr std::string_view kRecordingSuffix = ".fxrec";

/// Returns the process that has locked the directory; nullopt if there is none. 0: the process is
/// in another container.
std::optional<pid_t> writer_of(const std::string& directory);
/// Leaves the names of links for take_request(). Returns empty on success, else the reason.
std::string leave_request(const std::string& directory, const std::vector<std::string>& links);
/// Returns the text of the last answer(), or an empty text: the time, then a path on each line.
std::string last_answer(const std::string& directory);

}  // namespace fxagent
