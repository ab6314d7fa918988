// Commands and results that the database refused, in a file next to it. The file has its full size
// from the start, so a full disk still takes them. A restart moves them into the database, when
// that accepts writes again. The store's thread.
//
// agent/store/README.md has the layout. A damaged place counts as empty.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "agent/commands/journal.h"
#include "agent/file_handle.h"

namespace fxagent {

class UnrecordedFile final {
 public:
  /// Entries kept. A further one takes the place of the oldest.
  static constexpr std::size_t kPlaces = 2048;
  static constexpr std::size_t kPlaceBytes = 1024;

  /// `directory`: the store's. Opens nothing yet.
  explicit UnrecordedFile(const std::string& directory)
      : directory_(directory), path_(directory + "/fxagent.db.unrecorded") {}

  /// Opens the file or makes it, unless the open one is still there. Returns the entries that an
  /// earlier run left, by place. Call only while no other process uses the directory.
  std::vector<JournalEntry> open();
  /// Returns the entries that an earlier run left in the file in `directory`, which need not be
  /// writable. Call only while no other process uses the directory.
  static std::vector<JournalEntry> entries_in(const std::string& directory);
  /// Writes an entry in place of an earlier one with its device and id. If it is too large, omits
  /// the result, and the payload except an id that is a number, then the response topic. Does
  /// nothing without a file.
  void keep(const JournalEntry& entry);
  /// Synchronises the entries with the disk: they survive a power cut, too.
  void synchronise();
  /// True if no entry is kept.
  bool is_empty() const { return keys_.empty(); }
  /// Empties the file. Call when the database has every entry and has synchronised them.
  void clear();

 private:
  using Key = std::pair<std::string, std::string>;  ///< device and id

  bool make() const;
  bool has_full_size() const;
  std::vector<JournalEntry> read();
  void failed(const std::string& why);

  const std::string directory_;
  const std::string path_;
  FileHandle handle_;
  std::vector<Key> keys_;  ///< by place
  std::map<Key, std::size_t> places_;
  std::size_t next_ = 0;     ///< place to reuse when all are taken
  bool is_changed_ = false;  ///< not synchronised yet
  bool is_named_ = false;    ///< the directory, with the name of the file, is synchronised
  bool has_failed_ = false;  ///< logged
};

}  // namespace fxagent
