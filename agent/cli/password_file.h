// A file for a password, made for the user of the service.
#pragma once

#include <string>
#include <tl/expected.hpp>

namespace fxagent {

struct PasswordFile {
  bool is_new = false;  ///< false: it was there, and is as it was
  std::string owner;    ///< of a new one: "fxagent"
};

/// Creates `path` with mode 600 and `password` in it. Root gives it to the user `owner` if the
/// machine has that user; otherwise it belongs to the caller. Error: why it cannot be created.
tl::expected<PasswordFile, std::string> create_password_file(const std::string& path,
                                                             const std::string& password,
                                                             const std::string& owner);

}  // namespace fxagent
