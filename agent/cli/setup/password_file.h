// Creates a password file for the user of the service.
#pragma once

#include <string>
#include <tl/expected.hpp>

namespace fxagent {

struct PasswordFile {
  bool is_new = false;  ///< false: the file existed and is unchanged
  std::string owner;    ///< owner of a new file: "fxagent"
};

/// Creates `path` with mode 600 and `password` in it. When run by root, gives it to the user
/// `owner` if that user exists; otherwise it belongs to the caller. Error: why it cannot be
/// created.
tl::expected<PasswordFile, std::string> create_password_file(const std::string& path,
                                                             const std::string& password,
                                                             const std::string& owner);

}  // namespace fxagent
