#include "agent/config/machine.h"

#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <filesystem>
#include <fstream>
#include <map>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "agent/config/json/tree.h"
#include "agent/config/source.h"
#include "agent/log/log.h"
#include "agent/process/port_access.h"
#include "agent/process/this_process.h"
#include "agent/text/token_line.h"

namespace fxagent {
namespace {

/// True if the nearest existing directory on `path` is writable.
bool can_be_made(std::filesystem::path path) {
  std::error_code ignored;
  while (!std::filesystem::exists(path, ignored)) {
    const auto above = path.parent_path();
    if (above == path || above.empty()) return above.empty() && ::access(".", W_OK) == 0;
    path = above;
  }
  return std::filesystem::is_directory(path, ignored) && ::access(path.c_str(), W_OK | X_OK) == 0;
}

/// True if a directory above `path` lacks this permission (S_IXGRP or S_IXOTH), so that it keeps
/// users with only that permission away from the file.
bool lies_behind_closed_doors(const std::filesystem::path& path, mode_t right) {
  std::error_code fault;
  auto above = std::filesystem::canonical(path, fault).parent_path();
  struct stat directory {};
  for (; above.has_relative_path(); above = above.parent_path())
    if (::stat(above.c_str(), &directory) == 0 && (directory.st_mode & right) == 0) return true;
  return false;
}

/// Secrets of containers. They are readable by all, but the container has no other users.
constexpr std::string_view kContainerSecrets = "/run/secrets/";

/// Returns the users who can read the file without need: "everybody" or "its group"; empty if none.
std::string_view readers_beside_owner(const std::string& path) {
  const auto credentials = process_environment("CREDENTIALS_DIRECTORY");
  struct stat file {};
  if ((credentials && path.starts_with(*credentials + "/")) ||
      path.starts_with(kContainerSecrets) || ::stat(path.c_str(), &file) != 0 ||
      !S_ISREG(file.st_mode))
    return {};
  if ((file.st_mode & S_IROTH) != 0 && !lies_behind_closed_doors(path, S_IXOTH)) return "everybody";
  // A process that does not own the file may need the group's permission.
  const bool by_group = (file.st_mode & S_IRGRP) != 0 && file.st_uid == ::geteuid();
  return by_group && !lies_behind_closed_doors(path, S_IXGRP) ? "its group" : "";
}

/// True if a file can be read and its first line, the password, is empty.
bool has_empty_line(const std::string& path) {
  std::error_code none;
  if (!std::filesystem::is_regular_file(path, none)) return false;
  std::ifstream file(path);
  std::string line;
  if (!file.is_open()) return false;
  std::getline(file, line);
  return line.empty() || line == "\r";
}

constexpr std::string_view kOurName = "fxagent";

/// Returns why the agent that runs `file` cannot use this port; empty if it can.
std::string why_no_port(const std::string& path, const std::string& file) {
  if (is_no_port(path)) return shown(path) + " is not a serial port";
  if (::access(path.c_str(), R_OK | W_OK) != 0) {
    const int error = errno;
    return shown(path) + " cannot be opened: " + std::generic_category().message(error) +
           port_cure(path, error);
  }
  const auto holder = port_holder(path);
  if (!holder) return {};
  const bool is_agent = holder->program == kOurName;
  if (is_agent && is_called_with(holder->pid, file)) return {};
  return shown(path) + " is in use by another program: " + holder->program + ", pid " +
         std::to_string(holder->pid) + (is_agent ? ", which runs another config" : "") +
         "; end it, or use another port";
}

/// Returns which tokens of the file can be guessed, do not count, or stand for two names. A line is
/// "NAME TOKEN" or "TOKEN", so a name alone is a token.
std::vector<std::string> weak_tokens(const std::string& path) {
  constexpr std::size_t kShortest = 16;
  std::vector<std::string> faults;
  std::error_code ignored;
  if (!std::filesystem::is_regular_file(path, ignored)) return faults;  // a FIFO would block
  std::ifstream file(path);
  std::map<std::string, int> lines;  // by token
  int number = 0;
  for (std::string line; std::getline(file, line);) {
    ++number;
    const auto [name, token, is_too_long] = token_line(line);
    const std::string place = shown(path) + ": line " + std::to_string(number);
    if (is_too_long)
      faults.push_back(
          place + " is ignored, because it has more than a name and a token; no name has a space");
    if (is_too_long || token.empty()) continue;
    if (const auto [other, fresh] = lines.emplace(token, number); !fresh)
      faults.push_back(place + " has the token of line " + std::to_string(other->second));
    else if (token.size() < kShortest)
      faults.push_back(shown(path) + ": the token in line " + std::to_string(number) +
                       " can be guessed, because it has fewer than " + std::to_string(kShortest) +
                       " characters; a line is NAME TOKEN or TOKEN");
  }
  return faults;
}

}  // namespace

ConfigErrors check_files(const Config& config) {
  ConfigErrors missing;
  const auto must_be_readable = [&](std::string pointer, const std::string& path) {
    if (path.empty()) return;
    struct stat file {};
    int error = ::access(path.c_str(), R_OK) == 0 ? 0 : errno;
    if (error == 0 && ::stat(path.c_str(), &file) == 0 && S_ISDIR(file.st_mode)) error = EISDIR;
    if (error != 0)
      missing.push_back(
          {std::move(pointer), 0,
           shown(path) + " cannot be read: " + std::generic_category().message(error)});
  };
  for (const auto& [place, mqtt] : brokers_of(config)) {
    if (mqtt->tls) {
      must_be_readable(place + "/tls/ca_file", mqtt->tls->ca_file);
      must_be_readable(place + "/tls/cert_file", mqtt->tls->cert_file);
      must_be_readable(place + "/tls/key_file", mqtt->tls->key_file);
    }
    if (!mqtt->password_file.empty())  // goes before password_env
      must_be_readable(place + "/password_file", mqtt->password_file);
    else if (!mqtt->password_env.empty() && !process_environment(mqtt->password_env))
      missing.push_back({place + "/password_env", 0,
                         "the environment variable " + shown(mqtt->password_env) + " is not set"});
  }
  if (config.http) must_be_readable("/http/token_file", config.http->token_file);
  const auto must_be_writable = [&](std::string pointer, const std::string& path) {
    if (!path.empty() && !can_be_made(path))
      missing.push_back({std::move(pointer), 0, shown(path) + " cannot be written"});
  };
  must_be_writable("/store/path", config.store.path);
  if (config.recorder) must_be_writable("/recorder/path", config.recorder->path);
  return missing;
}

ConfigErrors weak_secrets(const Config& config) {
  ConfigErrors weak;
  const auto look = [&](std::string pointer, const std::string& path) {
    const std::string_view who = path.empty() ? std::string_view() : readers_beside_owner(path);
    if (!who.empty())
      weak.push_back(
          {std::move(pointer), 0,
           shown(path) + " can be read by " + std::string(who) + "; run chmod 600 on it"});
  };
  for (const auto& [place, mqtt] : brokers_of(config)) {
    if (mqtt->tls) look(place + "/tls/key_file", mqtt->tls->key_file);
    look(place + "/password_file", mqtt->password_file);
    if (has_empty_line(mqtt->password_file))
      weak.push_back(
          {place + "/password_file", 0,
           shown(mqtt->password_file) + " is empty: write the broker's password into it"});
  }
  if (config.http) look("/http/token_file", config.http->token_file);
  for (std::string& why : weak_tokens(config.http ? config.http->token_file : std::string()))
    weak.push_back({"/http/token_file", 0, std::move(why)});
  return weak;
}

ConfigErrors unavailable_ports(const Config& config, const std::string& file) {
  ConfigErrors list;
  std::map<dev_t, std::string> first;  // link of each device, whatever the name of its node
  for (std::size_t i = 0; i < config.links.size(); ++i) {
    const auto* serial = std::get_if<SerialSettings>(&config.links[i].channel);
    if (serial == nullptr) continue;
    struct stat port {};
    const bool is_device = ::stat(serial->path.c_str(), &port) == 0 && S_ISCHR(port.st_mode);
    const auto [other, fresh] = first.emplace(port.st_rdev, config.links[i].name);
    if (is_device && !fresh)
      list.push_back({"/links/" + std::to_string(i) + "/serial/path", 0,
                      shown(serial->path) + " is also the port of link " + other->second +
                          ", by another name: put the devices of both on one link"});
    else if (auto why = why_no_port(serial->path, file); !why.empty())
      list.push_back({"/links/" + std::to_string(i) + "/serial/path", 0, std::move(why)});
  }
  return list;
}

void log_warnings(Config& config) {
  for (const std::string& warning : std::exchange(config.warnings, {}))
    log::warn("config", {{"note", warning}});
  for (const ConfigError& secret : weak_secrets(config))
    log::warn("config", {{"note", text_of(secret)}});
}

}  // namespace fxagent
