// Marks each command just before its first byte leaves, in a small file that a kill -9 does not
// take away: after a restart a command without a result and without a mark surely did not leave.
// What can be lost is lost to the safe side: wherever the file is not surely complete, every
// command may have left. The store's thread, but for mark().
//
// The file is not synchronised with the disk: it says nothing after a power cut, and is told apart
// by the kernel's boot id. It is written once at its full size, so that a mark finds its place on a
// full disk too.
#pragma once

#include <cstdint>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "agent/commands/command_starts.h"

namespace fxagent {

class StartedCommands final : public CommandStarts {
 public:
  /// So many marks are kept. Of those that had to go, and of all commands that came before one of
  /// them, nothing is known.
  static constexpr std::size_t kKept = 2048;

  /// `directory`: the store's. Nothing is opened yet.
  explicit StartedCommands(const std::string& directory);
  ~StartedCommands() override;
  StartedCommands(const StartedCommands&) = delete;
  StartedCommands& operator=(const StartedCommands&) = delete;

  /// Commands of this run have numbers from this one on. Once, before all else.
  void begin_run(std::uint64_t first_number) { first_of_run_ = first_number; }
  /// The database is open and no command of this run has left: what earlier runs marked is read,
  /// and the file goes on.
  void go_on();
  /// The database has opened late: what earlier runs marked is read, and the file begins anew,
  /// since nobody has marked what this run has sent by now. `next_number`: of the next command.
  void begin_anew(std::uint64_t next_number);
  /// A clean end: every command has its result.
  void close();

  /// Whether an earlier run surely sent nothing of the command with this number. False of this
  /// run's.
  bool surely_not_sent(std::uint64_t number) const;

  /// Field thread.
  void mark(std::uint64_t number) override;

 private:
  struct Head;
  struct Record;
  struct Content;
  /// What earlier runs left.
  struct Earlier {
    std::uint64_t floor = 0;             ///< of commands below it nothing is known
    std::vector<std::uint64_t> started;  ///< in rising order
  };

  /// Nothing: there is no file, or it proves nothing.
  std::optional<Content> read(int handle) const;
  void take_over(int handle, const Content& content);
  void remember(const Content& content);
  void make(std::uint64_t next_number);
  void withdraw(const std::string& why);
  std::optional<Head> head_of_now(std::uint64_t floor) const;

  const std::string path_;
  const std::string database_;
  std::optional<Earlier> earlier_;
  std::uint64_t first_of_run_ = 0;

  std::mutex mutex_;  ///< guards all below: mark() is the field's
  int handle_ = -1;   ///< -1: there is no file, and nothing will be proven
  std::uint64_t floor_ = 0;
  std::uint64_t marks_ = 0;             ///< made in this file, of all runs
  std::vector<std::uint64_t> numbers_;  ///< by place
};

}  // namespace fxagent
