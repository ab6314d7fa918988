#include "agent/http/page_commands.h"

#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <fstream>
#include <mutex>
#include <string_view>
#include <utility>

#include "agent/config/json/tree.h"
#include "agent/file_handle.h"
#include "agent/log/log.h"
#include "agent/text/token_line.h"
#include "protocol/letter_case.h"

namespace fxagent {
namespace {

constexpr unsigned kUnauthorized = 401;
constexpr unsigned kForbidden = 403;
constexpr std::string_view kBearer = "Bearer ";
constexpr std::size_t kLongestName = 64;
constexpr std::chrono::seconds kLogEvery{10};

/// Takes the same time wherever the texts differ.
bool same(std::string_view one, std::string_view other) {
  unsigned difference = one.size() == other.size() ? 0 : 1;
  for (std::size_t i = 0; i < std::min(one.size(), other.size()); ++i)
    difference |= static_cast<unsigned>(one[i] ^ other[i]);
  return difference == 0;
}

/// Finds the token in the file. Returns its name, which may be empty; nullopt: the file has no such
/// token.
std::optional<std::string> name_of(std::string_view token, std::istream& file) {
  std::optional<std::string> found;
  for (std::string line; std::getline(file, line);) {
    const TokenLine known = token_line(line);
    if (!known.token.empty() && same(known.token, token)) found = known.name;
  }
  return found;
}

/// Returns the token of an Authorization; empty if it has none.
std::string_view token_of(std::string_view authorization) {
  if (!equal_but_for_case(authorization.substr(0, kBearer.size()), kBearer)) return {};
  authorization.remove_prefix(kBearer.size());
  return authorization.substr(0, authorization.find_last_not_of(' ') + 1);
}

/// True if the request comes from the page itself or from no browser: browsers name the origin of
/// every POST. The port belongs to the origin.
bool is_own_origin(const HttpRequest& request) {
  if (!request.fetch_site.empty() && request.fetch_site != "same-origin") return false;
  if (request.origin.empty()) return true;
  const std::size_t scheme = request.origin.find("://");
  return scheme != request.origin.npos && request.origin.substr(scheme + 3) == request.host;
}

/// Returns the text of a member; empty if it is absent or not a string.
std::string text_of(const ConfigNode* member) {
  const bool is_string = member != nullptr && member->kind == ConfigNode::Kind::string;
  return is_string ? member->text : std::string();
}

/// Removes a member whose value is a string. Everything else stays as it was sent, for the checks
/// of a command.
std::string without(const ConfigNode& member, std::string_view text) {
  const auto& members = member.parent->children;
  const bool is_first = &member == &members.front();
  // The offset of a key or a string is that of its last byte.
  const std::size_t begin = text.rfind(is_first ? '"' : ',', member.key_offset - 1);
  const std::size_t last =
      is_first && members.size() > 1 ? text.find(',', member.offset) : member.offset;
  return std::string(text.substr(0, begin)).append(text.substr(last + 1));
}

}  // namespace

/// Results on their way to the server's thread.
struct PageCommands::Inbox {
  const FileHandle file{::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)};
  std::mutex mutex{};
  std::vector<Result> results{};  ///< under the mutex
};

PageCommands::PageCommands(std::string token_file, std::function<void(RelayedCommand)> place)
    : token_file_(std::move(token_file)),
      place_(std::move(place)),
      inbox_(std::make_shared<Inbox>()) {}

std::optional<HttpAnswer> PageCommands::place(const HttpRequest& request) {
  if (token_file_.empty())
    return refusal(kForbidden,
                   "this page is read-only; http.token_file of the config allows commands");
  if (!is_own_origin(request))
    return refusal(kForbidden,
                   "a command may come only from the page itself, not from another site");
  std::ifstream file(token_file_);
  if (!file) {
    log::error("page", {{"token_file", token_file_}, {"reason", "cannot be read"}});
    return refusal(kUnavailable, "http.token_file cannot be read; the log names it");
  }
  const std::string_view token = token_of(request.authorization);
  const auto name = token.empty() ? std::nullopt : name_of(token, file);
  if (!name) {
    if (const auto now = std::chrono::steady_clock::now(); now >= logs_again_) {
      log::warn("page", {{"command", "refused"}, {"reason", "no valid token"}});
      logs_again_ = now + kLogEvery;
    }
    return refusal(kUnauthorized, "Authorization must be Bearer and a token of http.token_file");
  }
  const auto body = ConfigTree::parse(request.body, ConfigTree::Folding::none);
  if (!body) return refusal(kBadRequest, body.error().text);
  const ConfigNode& root = body->root();
  const ConfigNode* const device = root.find("device");
  if (text_of(device).empty())
    return refusal(kBadRequest,
                   "the body must be a command as JSON, with the name of its device in \"device\"");
  if (std::ranges::count(root.children, "device", &ConfigNode::key) > 1)
    return refusal(kBadRequest, "key 'device' occurs twice");
  RelayedCommand command;
  command.device = device->text;
  command.payload = without(*device, request.body);
  command.sender =
      "page:" + (name->empty() ? text_of(root.find("by")).substr(0, kLongestName) : *name);
  command.reply = [inbox = inbox_, number = request.number](const std::string& result) {
    const std::lock_guard lock(inbox->mutex);
    inbox->results.push_back({number, result + "\n"});
    ::eventfd_write(inbox->file, 1);
  };
  place_(std::move(command));
  return std::nullopt;
}

std::vector<PageCommands::Result> PageCommands::take_results() {
  const std::lock_guard lock(inbox_->mutex);
  eventfd_t count = 0;
  ::eventfd_read(inbox_->file, &count);
  return std::exchange(inbox_->results, {});
}

int PageCommands::file() const { return inbox_->file; }

}  // namespace fxagent
