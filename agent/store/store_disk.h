// The store's file as its parts share it: opens it, sets a damaged one aside, makes the commits,
// and knows whether the disk takes anything. Every fault of SQLite ends here: the state becomes
// `memory` and the caller is told false. A few functions above twenty: a commit that finds damage
// opens a fresh file, so opening, failing and committing belong together. The store's thread.
#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "agent/config/config.h"
#include "agent/store/sqlite.h"
#include "agent/store/store_file.h"
#include "agent/store/store_part.h"

namespace fxagent {

class StoreDisk final {
 public:
  /// Whether a commit is synchronised with the disk even where `sync: offline` leaves that out: a
  /// power cut loses no sample that counts as stored.
  enum class Sync : std::uint8_t { as_configured, full };
  using Work = std::function<void()>;

  StoreDisk(const StoreConfig& config, std::int64_t utc_ms) : config_(config), utc_ms_(utc_ms) {}
  StoreDisk(const StoreDisk&) = delete;
  StoreDisk& operator=(const StoreDisk&) = delete;

  /// In the order in which they load and write. Before open(), once. Each of them outlives every
  /// call here but the destructor's.
  void share_with(std::vector<StorePart*> parts) { parts_ = std::move(parts); }

  /// Opens or makes the file, and the directory. A damaged file is set aside as
  /// fxagent.db.corrupt-<utc_ms>. Where it fails is_writable() is false, and the reason is logged.
  void open();
  /// Where an open file took nothing: asks it again.
  void try_to_write();
  /// Whether the open files were deleted or replaced by others.
  bool is_misplaced() const;
  /// Lets go of such files, and of what was in them.
  void abandon();
  /// The clean end: what is in the log is copied into the file.
  void close();

  bool is_open() const { return file_ != nullptr; }
  bool is_writable() const { return writable_; }
  /// Why not; empty while it is.
  const std::string& last_failure() const { return last_failure_; }
  /// Whether a file has opened in this run, and was not abandoned since.
  bool was_open() const { return was_open_; }
  /// While is_open().
  SQLite::Database& database() { return file_->db; }
  /// The name of the damaged file that was set aside in this run; empty: none was.
  const std::string& set_aside() const { return set_aside_; }
  /// ms UTC, as the store was told last.
  std::int64_t utc_ms() const { return utc_ms_; }
  void set_utc_ms(std::int64_t utc_ms) { utc_ms_ = utc_ms; }

  /// Carries out `work` in one transaction. False: nothing of it was kept. `doing` names it in the
  /// log.
  bool commit(std::string_view doing, Sync sync, const Work& work);
  /// Carries out `work` on the open file without a transaction around it; false: it failed.
  bool attempt(std::string_view doing, const Work& work);
  /// The same for a single row. Where it could not be read the file can be written all the same,
  /// unless it is damaged.
  bool read(const Work& work);

  /// Whether a part has something to write.
  bool has_pending() const;
  /// Within a commit: all that waits in memory, of every part. Returns whether some is left.
  bool write_pending(std::size_t at_most = std::numeric_limits<std::size_t>::max());
  /// Commits what waits in memory, in pieces where it is much. False: the disk took not all of it.
  bool flush();

 private:
  void let_go(StorePart::Rows rows);
  void start_anew(const std::string& why);
  void failed(std::string_view doing, const sqlite::Fault& fault);
  bool flush_all();

  const StoreConfig config_;
  std::vector<StorePart*> parts_;
  std::unique_ptr<DirectoryLock> lock_;
  std::unique_ptr<StoreFile> file_;  ///< null: it could not be opened
  bool writable_ = false;
  bool was_open_ = false;
  bool mending_ = false;  ///< a fresh file is being made in place of a damaged one
  std::string last_failure_;
  std::string set_aside_;
  std::int64_t utc_ms_;
};

}  // namespace fxagent
