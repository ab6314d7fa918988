// Marks each command just before its first byte leaves, in a small file that survives a kill -9.
// After a restart, a command with neither result nor mark was surely not sent. Losses err on the
// safe side: if the file may be incomplete, every command counts as possibly sent. The store's
// thread, except mark().
//
// The file is not synchronised with the disk. After a power cut it proves nothing, which the
// kernel's boot id reveals. It is written once at its full size, so a mark has room even on a full
// disk.
#pragma once

#include <cstdint>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "agent/file_handle.h"

namespace fxagent {

class StartedCommands final {
 public:
  /// Number of marks kept. Nothing is known of a command whose mark was overwritten, and of all
  /// earlier commands.
  static constexpr std::size_t kKept = 2048;

  /// `directory`: the store's. Opens nothing yet.
  explicit StartedCommands(const std::string& directory);
  StartedCommands(const StartedCommands&) = delete;
  StartedCommands& operator=(const StartedCommands&) = delete;

  /// Commands of this run have numbers from `first_number`. Call once, before all else.
  void begin_run(std::uint64_t first_number) { first_of_run_ = first_number; }
  /// Call when the directory is locked and no command of this run has left. Reads the marks of
  /// earlier runs and continues the file.
  void go_on();
  /// Call when the database has opened late. Reads the marks of earlier runs and starts a new file,
  /// since commands that this run has sent are not marked. `next_number`: number of the next
  /// command.
  void begin_anew(std::uint64_t next_number);
  /// Clean end: deletes the file. Call only if every command has its result.
  void close();

  /// True if an earlier run surely sent nothing of this command. False for commands of this run.
  bool surely_not_sent(std::uint64_t number) const;

  /// Marks the command, or empties the file if that fails. Thread of the marks.
  void mark(std::uint64_t number);

 private:
  struct Head;
  struct Record;
  struct Content;
  /// Marks of earlier runs.
  struct Earlier {
    std::uint64_t floor = 0;  ///< nothing is known of commands below it
    std::set<std::uint64_t> started;
  };

  /// Returns nullopt if there is no file, or it proves nothing.
  std::optional<Content> read(int handle) const;
  void remember(const Content& content);
  void make(std::uint64_t next_number);
  void withdraw(const std::string& why);
  std::optional<Head> head_of_now(std::uint64_t floor) const;

  const std::string path_;
  const std::string database_;
  std::optional<Earlier> earlier_;
  std::uint64_t first_of_run_ = 0;

  std::mutex mutex_;   ///< guards all below: mark() runs on another thread
  FileHandle handle_;  ///< not open: no file, so nothing will be proven
  std::uint64_t floor_ = 0;
  std::uint64_t marks_ = 0;             ///< made in this file, by all runs
  std::vector<std::uint64_t> numbers_;  ///< by place
};

}  // namespace fxagent
