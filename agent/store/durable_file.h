// A small file in the store's directory that is replaced as a whole: after a crash or a power cut
// it is the one before or the new one, never half of either. Any thread, one at a time.
#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <tl/expected.hpp>

namespace fxagent {

class DurableFile final {
 public:
  /// Touches nothing yet.
  DurableFile(std::string directory, const std::string& name);
  ~DurableFile();
  DurableFile(const DurableFile&) = delete;
  DurableFile& operator=(const DurableFile&) = delete;

  const std::string& path() const { return path_; }

  /// What is in it; nothing: it is not there. The error says why it cannot be read: a link, another
  /// user's file or more than `most` bytes are not read either.
  tl::expected<std::optional<std::string>, std::string> read(std::size_t most) const;
  /// Keeps every other process that asks too away from the directory's files, for as long as this
  /// lives. Empty: it is ours, now or since before. Makes the directory (0700) where it is not
  /// there.
  std::string lock();
  /// Empty: the file has this text, on disk. Else why not: it has the text of before, or this one
  /// where the directory alone could not be synchronised, and a power cut brings back either. Makes
  /// the directory (0700) where it is not there; the file is 0600.
  std::string write(std::string_view text) const;
  /// Empty: the file is not there any more. Else why it still is.
  std::string remove() const;

 private:
  class Lock;

  std::string synchronise_directory() const;

  const std::string directory_;
  const std::string path_;
  std::unique_ptr<Lock> lock_;
};

}  // namespace fxagent
