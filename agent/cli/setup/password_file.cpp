#include "agent/cli/setup/password_file.h"

#include <fcntl.h>
#include <pwd.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <system_error>

#include "agent/file_handle.h"

namespace fxagent {
namespace {

// Safe: the command line has one thread.
// NOLINTBEGIN(concurrency-mt-unsafe)
std::string name_of(uid_t user) {
  const passwd* entry = ::getpwuid(user);
  return entry == nullptr ? std::to_string(user) : entry->pw_name;
}
const passwd* entry_of(const std::string& user) { return ::getpwnam(user.c_str()); }
// NOLINTEND(concurrency-mt-unsafe)

}  // namespace

tl::expected<PasswordFile, std::string> create_password_file(const std::string& path,
                                                             const std::string& password,
                                                             const std::string& owner) {
  const auto failed = [&path] {
    return tl::unexpected(path + " cannot be created: " + std::generic_category().message(errno));
  };
  const FileHandle file(::open(path.c_str(), O_CREAT | O_EXCL | O_WRONLY | O_CLOEXEC, 0600));
  if (file < 0 && errno == EEXIST) return PasswordFile{};
  if (file < 0) return failed();
  bool done = true;
  if (::geteuid() == 0)
    if (const passwd* entry = entry_of(owner))
      done = ::fchown(file, entry->pw_uid, entry->pw_gid) == 0;
  const std::string text = password.empty() ? password : password + "\n";
  done = done && ::write(file, text.data(), text.size()) == static_cast<ssize_t>(text.size());
  struct stat made {};
  done = done && ::fstat(file, &made) == 0;
  return done ? tl::expected<PasswordFile, std::string>(PasswordFile{true, name_of(made.st_uid)})
              : failed();
}

}  // namespace fxagent
