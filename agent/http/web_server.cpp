#include "agent/http/web_server.h"

#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <system_error>

#include "agent/http/exposition.h"
#include "agent/http/listening_socket.h"
#include "agent/http/page_files.h"
#include "agent/http/probe.h"
#include "agent/log/log.h"
#include "agent/log/recent_events.h"
#include "agent/without_signals.h"
#include "protocol/letter_case.h"

namespace fxagent {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr const char* kExposition = "text/plain; version=0.0.4; charset=utf-8";
constexpr unsigned kMisdirected = 421;

constexpr const char* kNote = "the agent continues without its HTTP server";

HttpAnswer answer_of(Probe probe) {
  return json_answer(probe.good ? kOk : kUnavailable, std::move(probe.json));
}

HttpAnswer wrong_name() {
  return refusal(kMisdirected,
                 "this name is not known here: call the page by its address, or add the name to "
                 "http.hosts of the config");
}

}  // namespace

WebServer::WebServer(HttpConfig config, StatusBoard& board,
                     std::function<void(RelayedCommand)> place, const FlightRecorder* recorder)
    : config_(std::move(config)),
      board_(board),
      end_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)),
      api_(recorder),
      commands_(config_.token_file, std::move(place)) {
  if (config_.page) {
    board_.want_values();
    log::keep_events();
  }
  try {
    if (end_ < 0) throw std::system_error(errno, std::generic_category(), "no eventfd");
    const WithoutSignals quiet;
    thread_ = std::thread([this] { work(); });
  } catch (const std::system_error& error) {
    log::error("metrics", {{"state", "down"}, {"reason", error.what()}, {"note", kNote}});
  }
}

WebServer::~WebServer() {
  if (!thread_.joinable()) return;
  ::eventfd_write(end_, 1);
  thread_.join();
}

void WebServer::work() {
  std::string told;
  while (true) {
    if (const auto server = started(told)) return serve(*server);
    if (!wait(-1, Clock::now() + kRetry)) return;
  }
}

std::unique_ptr<HttpServer> WebServer::started(std::string& told) {
  auto socket = ListeningSocket::open(config_);
  std::string address = socket ? socket->address() : "";
  auto server = std::move(socket).and_then([this](ListeningSocket&& listening) {
    return HttpServer::start(
        std::move(listening), [this](const HttpRequest& request) { return answer(request); },
        config_.page ? PageCommands::kMostBytes : 0);
  });
  if (server) {
    log::info("metrics", {{"state", "listening"}, {"listen", address}});
    return std::move(*server);
  }
  if (server.error().text != told) {
    told = server.error().text;
    log::error(
        "metrics",
        {{"state", "down"}, {"reason", told}, {"note", std::string(kNote) + ", and tries again"}});
  }
  return nullptr;
}

void WebServer::serve(HttpServer& server) {
  server_ = &server;
  while (wait(server.file(), server.run(Clock::now())))
    for (const PageCommands::Result& result : commands_.take_results())
      server.finish(result.number, json_answer(kOk, result.text));
}

bool WebServer::wait(int file, SteadyTime until) const {
  const auto left = std::chrono::ceil<milliseconds>(until - Clock::now());
  const int timeout =
      until == SteadyTime::max()
          ? -1
          : static_cast<int>(std::clamp(left, milliseconds(0), milliseconds(60'000)).count());
  std::array<pollfd, 3> files{pollfd{end_, POLLIN, 0}, pollfd{file, POLLIN, 0},
                              pollfd{commands_.file(), POLLIN, 0}};
  ::poll(files.data(), files.size(), timeout);
  return files[0].revents == 0;
}

std::optional<HttpAnswer> WebServer::answer(const HttpRequest& request) {
  const std::string_view path = request.path;
  if (request.is_post) return command(request);
  if (path == "/metrics") return metrics();
  if (path == "/healthz") return answer_of(health_of(status().get(), Clock::now()));
  if (path == "/readyz") return answer_of(readiness_of(status().get(), Clock::now()));
  if (config_.page) return page(request);
  return refusal(kNotFound, "there are /metrics, /healthz and /readyz");
}

std::optional<HttpAnswer> WebServer::command(const HttpRequest& request) {
  if (request.path != "/api/command") return refusal(kNotAllowed, "only GET and HEAD");
  if (!is_our_name(request.host)) return wrong_name();
  if (server_->is_full()) return refusal(kUnavailable, "too many commands wait for their result");
  return commands_.place(request);
}

HttpAnswer WebServer::page(const HttpRequest& request) {
  if (!is_our_name(request.host)) return wrong_name();
  if (const PageFile* file = page_file(request.path)) {
    if (request.if_none_match == file->etag)
      return {kNotModified, file->type, std::make_shared<const std::string>(), file->etag};
    return {kOk, file->type, std::make_shared<const std::string>(file->body), file->etag};
  }
  if (!request.path.starts_with("/api/"))
    return refusal(kNotFound, "there are the page at /, /metrics, /healthz and /readyz");
  auto now_here = status();
  if (is_stale(now_here.get(), Clock::now()))
    return answer_of(health_of(now_here.get(), Clock::now()));
  return api_.answer(request, std::move(now_here));
}

bool WebServer::is_our_name(std::string_view host) const {
  // The port, if any: behind the last colon, and behind the bracket of an IPv6 address.
  const std::size_t colon = host.rfind(':');
  if (colon != host.npos && host.find(']', colon) == host.npos) host = host.substr(0, colon);
  if (host.starts_with('[')) return true;
  const bool is_ipv4 =
      !host.empty() && host.find_first_not_of("0123456789.") == std::string_view::npos;
  const auto is_host = [&](std::string_view name) { return equal_but_for_case(name, host); };
  return is_ipv4 || is_host("localhost") || std::ranges::any_of(config_.hosts, is_host);
}

HttpAnswer WebServer::metrics() {
  const auto now_here = status();
  // Old numbers would look like new ones.
  if (is_stale(now_here.get(), Clock::now()))
    return answer_of(health_of(now_here.get(), Clock::now()));
  if (now_here != shown_) {
    text_ = std::make_shared<const std::string>(exposition(*now_here, server_->closed()));
    shown_ = now_here;
  }
  return {kOk, kExposition, text_, {}};
}

std::shared_ptr<const AgentStatus> WebServer::status() {
  const auto now = Clock::now();
  const auto patience = now < ask_again_ ? milliseconds(0) : kPatience;
  auto newest = board_.read(now, patience);
  if (patience > milliseconds(0) && Clock::now() - now >= kPatience)
    ask_again_ = Clock::now() + StatusBoard::kFresh;
  return newest;
}

}  // namespace fxagent
