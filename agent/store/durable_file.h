// A small file in the store's directory that is replaced as a whole: after a crash or a power cut
// it is the one before or the new one, never half of either. Any thread, one at a time.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <tl/expected.hpp>

namespace fxagent {

class DurableFile final {
 public:
  /// Touches nothing yet.
  DurableFile(std::string directory, const std::string& name);

  const std::string& path() const { return path_; }

  /// What is in it; nothing: it is not there. The error says why it cannot be read: a link, another
  /// user's file or more than `most` bytes are not read either.
  tl::expected<std::optional<std::string>, std::string> read(std::size_t most) const;
  /// Empty: the file has this text, on disk. Else why not, and it has the text of before. Makes the
  /// directory (0700) where it is not there; the file is 0600.
  std::string write(std::string_view text) const;
  /// Empty: the file is not there any more. Else why it still is.
  std::string remove() const;

 private:
  std::string synchronise_directory() const;

  const std::string directory_;
  const std::string path_;
};

}  // namespace fxagent
