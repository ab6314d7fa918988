// A small file in the store's directory that is replaced atomically: after a crash or a power cut
// it has either the old or the new content. Any thread, one at a time.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <tl/expected.hpp>

#include "agent/file_handle.h"

namespace fxagent {

class DurableFile final {
 public:
  /// Does not touch the disk.
  DurableFile(std::string directory, const std::string& name);
  DurableFile(const DurableFile&) = delete;
  DurableFile& operator=(const DurableFile&) = delete;

  const std::string& path() const { return path_; }

  /// Returns the content, or nullopt if the file does not exist. The error says why it cannot be
  /// read. Refuses a link, another user's file, and more than `most` bytes.
  tl::expected<std::optional<std::string>, std::string> read(std::size_t most) const;
  /// Locks the directory, for the lifetime of this object, against other processes that call
  /// lock(). Creates the directory (0700) if it does not exist. Waits at most 500 ms for a process
  /// that has the lock. Returns empty if this object has it, else the reason.
  std::string lock();
  /// Replaces the file and synchronises it with the disk. Creates the directory (0700) if it does
  /// not exist; the file is 0600. Returns empty on success, else the reason. After a failure the
  /// file has the old text. If only the directory could not be synchronised it has the new text,
  /// and a power cut may bring back either.
  std::string write(std::string_view text) const;
  /// Deletes the file. Returns empty if it is gone. Else returns the reason: it is still there, or
  /// a power cut may bring it back.
  std::string remove() const;

 private:
  std::string synchronise_directory() const;

  const std::string directory_;
  const std::string path_;
  FileHandle locked_;  ///< the directory itself, so no lock file stays behind
};

}  // namespace fxagent
