#include "agent/http/http_server.h"

#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <string>
#include <utility>

#include "agent/http/http_library.h"
#include "agent/json_writer.h"

namespace fxagent {
namespace {

using std::chrono::milliseconds;

constexpr MHD_UNSIGNED_LONG_LONG kMostWaitMs = 60'000;

/// Sent with every answer. The browser runs only our own scripts and styles, connects nowhere else,
/// and asks before it reuses a copy.
constexpr std::array kHeaders{
    std::pair("Content-Security-Policy",
              "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
              "img-src data:; frame-ancestors 'none'; base-uri 'none'; form-action 'none'; "
              "require-trusted-types-for 'script'"),
    std::pair("X-Content-Type-Options", "nosniff"), std::pair("Referrer-Policy", "no-referrer"),
    std::pair("Cross-Origin-Resource-Policy", "same-origin"),
    std::pair("Cache-Control", "no-cache")};

/// Reference to the body, owned by the response that sends it.
using SharedBody = std::shared_ptr<const std::string>;
void let_go(void* body) { delete static_cast<SharedBody*>(body); }

MHD_Result send(MHD_Connection* connection, const HttpAnswer& answer) {
  const HttpLibrary& http = *http_library();
  auto* const owned = new SharedBody(answer.body);
  // The library only reads the bytes.
  char* const bytes = const_cast<char*>((*owned)->data());
  MHD_Response* const response = http.create_response((*owned)->size(), bytes, let_go, owned);
  if (response == nullptr) {
    let_go(owned);
    return MHD_NO;
  }
  http.add_response_header(response, MHD_HTTP_HEADER_CONTENT_TYPE, answer.type);
  http.add_response_header(response, MHD_HTTP_HEADER_CONNECTION, "close");
  for (const auto& [name, value] : kHeaders) http.add_response_header(response, name, value);
  if (!answer.etag.empty())
    http.add_response_header(response, MHD_HTTP_HEADER_ETAG, answer.etag.c_str());
  if (answer.status == MHD_HTTP_METHOD_NOT_ALLOWED)
    http.add_response_header(response, MHD_HTTP_HEADER_ALLOW, "GET, HEAD");
  const MHD_Result queued = http.queue_response(connection, answer.status, response);
  http.destroy_response(response);
  return queued;
}

std::string_view view_of(const char* text) { return text == nullptr ? std::string_view() : text; }

MHD_Result take_argument(void* arguments, MHD_ValueKind /*kind*/, const char* name,
                         const char* value) noexcept {
  static_cast<decltype(HttpRequest::arguments)*>(arguments)->emplace(name, view_of(value));
  return MHD_YES;
}

HttpRequest request_of(MHD_Connection* connection, const char* path) {
  const HttpLibrary& http = *http_library();
  const auto header = [&](const char* name) {
    return view_of(http.lookup_connection_value(connection, MHD_HEADER_KIND, name));
  };
  HttpRequest request{path, header(MHD_HTTP_HEADER_HOST), header(MHD_HTTP_HEADER_IF_NONE_MATCH)};
  http.get_connection_values(connection, MHD_GET_ARGUMENT_KIND, &take_argument, &request.arguments);
  return request;
}

bool is_known(std::string_view method) {
  return method == MHD_HTTP_METHOD_GET || method == MHD_HTTP_METHOD_HEAD;
}

}  // namespace

/// Callbacks of the library, with the server as their first argument. The server's thread only.
struct HttpServer::Callbacks {
  static MHD_Result request(void* server, MHD_Connection* connection, const char* path,
                            const char* method, const char* /*version*/, const char* /*upload*/,
                            std::size_t* /*upload_size*/, void** /*of_request*/) noexcept {
    auto* const self = static_cast<HttpServer*>(server);
    self->answered(connection);
    if (!is_known(method))
      return send(connection, refusal(MHD_HTTP_METHOD_NOT_ALLOWED, "only GET and HEAD"));
    return send(connection, self->answer_(request_of(connection, path)));
  }
  static void connection(void* server, MHD_Connection* connection, void** /*of_connection*/,
                         MHD_ConnectionNotificationCode what) noexcept {
    auto* const self = static_cast<HttpServer*>(server);
    if (what == MHD_CONNECTION_NOTIFY_STARTED)
      self->began(connection);
    else
      self->ended(connection);
  }
};

HttpAnswer refusal(unsigned status, std::string_view why) {
  json::Writer out;
  out.begin_object().key("error").string(why).end_object();
  return {status, kJson, std::make_shared<const std::string>(out.take() + "\n"), {}};
}

Result<std::unique_ptr<HttpServer>> HttpServer::start(ListeningSocket socket, Answer answer) {
  const HttpLibrary* const http = http_library();
  if (http == nullptr)
    return fail(ErrorCode::link_down,
                "libmicrohttpd.so.12 could not be loaded; install the package libmicrohttpd12");
  std::unique_ptr<HttpServer> server(new HttpServer(std::move(socket), std::move(answer)));
  // No thread of its own: run() is its loop.
  server->daemon_ = http->start_daemon(
      MHD_USE_EPOLL, 0, nullptr, nullptr, &Callbacks::request, server.get(),
      MHD_OPTION_LISTEN_SOCKET, static_cast<MHD_socket>(server->socket_.take_file()),
      MHD_OPTION_CONNECTION_LIMIT, kMostConnections, MHD_OPTION_PER_IP_CONNECTION_LIMIT,
      kMostOfOneAddress, MHD_OPTION_CONNECTION_MEMORY_LIMIT, kMostHeaderBytes,
      MHD_OPTION_CONNECTION_TIMEOUT, static_cast<unsigned>(kLongestSilence.count()),
      MHD_OPTION_STRICT_FOR_CLIENT, 1, MHD_OPTION_NOTIFY_CONNECTION, &Callbacks::connection,
      server.get(), MHD_OPTION_END);
  if (server->daemon_ == nullptr)
    return fail(ErrorCode::link_down, "the HTTP server does not start: no memory or open files");
  server->file_ = http->get_daemon_info(server->daemon_, MHD_DAEMON_INFO_EPOLL_FD)->epoll_fd;
  return server;
}

HttpServer::HttpServer(ListeningSocket socket, Answer answer)
    : socket_(std::move(socket)), answer_(std::move(answer)) {}

HttpServer::~HttpServer() {
  socket_.remove_path();
  if (daemon_ != nullptr) http_library()->stop_daemon(daemon_);
}

SteadyTime HttpServer::run(SteadyTime now) {
  const HttpLibrary& http = *http_library();
  now_ = now;
  for (Open& open : open_) {
    if (now - open.since < kLongestConnection) break;
    shut(open, closed_.slow);
  }
  http.run(daemon_);
  MHD_UNSIGNED_LONG_LONG silence_ms = 0;
  SteadyTime wake = SteadyTime::max();
  if (http.get_timeout(daemon_, &silence_ms) == MHD_YES)
    wake = now + milliseconds(std::min<MHD_UNSIGNED_LONG_LONG>(silence_ms, kMostWaitMs));
  // Connections past their limit were shut and need no wake-up.
  for (const Open& open : open_)
    if (const SteadyTime end = open.since + kLongestConnection; end > now)
      return std::min(wake, end);
  return wake;
}

void HttpServer::began(MHD_Connection* connection) {
  if (open_.size() >= kCrowded) {
    const auto slowest = std::ranges::find(open_, false, &Open::is_shut);
    if (slowest != open_.end()) shut(*slowest, closed_.crowded);
  }
  open_.push_back({connection, now_});
}

void HttpServer::ended(MHD_Connection* connection) {
  const auto found = std::ranges::find(open_, connection, &Open::connection);
  if (found == open_.end()) return;
  if (!found->is_shut && !found->is_answered) ++closed_.unanswered;
  open_.erase(found);
}

void HttpServer::answered(MHD_Connection* connection) {
  const auto found = std::ranges::find(open_, connection, &Open::connection);
  if (found != open_.end()) found->is_answered = true;
}

/// The library then finds the connection ended, and removes it.
void HttpServer::shut(Open& open, std::uint64_t& count) {
  if (std::exchange(open.is_shut, true)) return;
  ++count;
  const auto* const info =
      http_library()->get_connection_info(open.connection, MHD_CONNECTION_INFO_CONNECTION_FD);
  if (info != nullptr) ::shutdown(info->connect_fd, SHUT_RDWR);
}

}  // namespace fxagent
