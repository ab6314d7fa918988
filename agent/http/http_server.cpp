#include "agent/http/http_server.h"

#include <dlfcn.h>
#include <microhttpd.h>
#include <sys/socket.h>

#include <array>
#include <utility>

#include "agent/text/json_writer.h"

namespace fxagent {
namespace {

using std::chrono::milliseconds;

constexpr MHD_UNSIGNED_LONG_LONG kMostWaitMs = 60'000;
// The version whose header this was compiled with: Debian's libmicrohttpd12.
constexpr const char* kLibrary = "libmicrohttpd.so.12";
constexpr unsigned kGatewayTimeout = 504;
constexpr int kLastRuns = 10;  // enough to send a short answer

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

/// A function of the library, or null; becomes a pointer of the type that it is assigned to.
struct FoundFunction {
  void* address = nullptr;
  template <class Function>
  operator Function*() const {
    return reinterpret_cast<Function*>(address);
  }
};

/// Functions of libmicrohttpd that are used, named without MHD_. It is loaded when it is first
/// needed: linking it would bring GnuTLS and eight more libraries into every process, even into an
/// agent that serves no metrics.
struct HttpLibrary {
  FoundFunction find(const char* name) {
    void* const address = is_whole ? ::dlsym(library, name) : nullptr;
    is_whole = address != nullptr;
    return {address};
  }

  // Members are initialised in this order: each find() needs these two.
  void* library = ::dlopen(kLibrary, RTLD_NOW | RTLD_LOCAL);
  bool is_whole = library != nullptr;  ///< and so far it has every function
  decltype(&MHD_start_daemon) start_daemon = find("MHD_start_daemon");
  decltype(&MHD_stop_daemon) stop_daemon = find("MHD_stop_daemon");
  decltype(&MHD_run) run = find("MHD_run");
  decltype(&MHD_get_timeout) get_timeout = find("MHD_get_timeout");
  decltype(&MHD_get_daemon_info) get_daemon_info = find("MHD_get_daemon_info");
  decltype(&MHD_get_connection_info) get_connection_info = find("MHD_get_connection_info");
  decltype(&MHD_lookup_connection_value) lookup_connection_value =
      find("MHD_lookup_connection_value");
  decltype(&MHD_get_connection_values) get_connection_values = find("MHD_get_connection_values");
  decltype(&MHD_create_response_from_buffer_with_free_callback_cls) create_response =
      find("MHD_create_response_from_buffer_with_free_callback_cls");
  decltype(&MHD_add_response_header) add_response_header = find("MHD_add_response_header");
  decltype(&MHD_queue_response) queue_response = find("MHD_queue_response");
  decltype(&MHD_destroy_response) destroy_response = find("MHD_destroy_response");
  decltype(&MHD_suspend_connection) suspend_connection = find("MHD_suspend_connection");
  decltype(&MHD_resume_connection) resume_connection = find("MHD_resume_connection");
};

/// Returns null if the library is not installed, or not the version that this program was built
/// with. Once loaded it stays.
const HttpLibrary* http_library() {
  static const HttpLibrary library;
  return library.is_whole ? &library : nullptr;
}

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
  if (answer.status == kNotAllowed)
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
  request.authorization = header(MHD_HTTP_HEADER_AUTHORIZATION);
  request.origin = header(MHD_HTTP_HEADER_ORIGIN);
  request.fetch_site = header("Sec-Fetch-Site");
  http.get_connection_values(connection, MHD_GET_ARGUMENT_KIND, &take_argument, &request.arguments);
  return request;
}

}  // namespace

/// Callbacks of the library, with the server as their first argument. The server's thread only.
struct HttpServer::Callbacks {
  static MHD_Result request(void* server, MHD_Connection* connection, const char* path,
                            const char* method, const char* /*version*/, const char* upload,
                            std::size_t* upload_size, void** /*of_request*/) noexcept {
    auto& self = *static_cast<HttpServer*>(server);
    const auto open = std::ranges::find(self.open_, connection, &Open::connection);
    if (open == self.open_.end()) return MHD_NO;
    const std::string_view how = method;
    const bool is_post = how == MHD_HTTP_METHOD_POST && self.most_body_ > 0;
    if (how != MHD_HTTP_METHOD_GET && how != MHD_HTTP_METHOD_HEAD && !is_post) {
      open->is_answered = true;
      return send(connection, refusal(kNotAllowed, "only GET and HEAD"));
    }
    // The library calls once for the headers, for each part of the body, and at its end.
    if (is_post && !std::exchange(open->has_begun, true)) return MHD_YES;
    if (*upload_size > 0) {
      const std::size_t room = self.most_body_ + 1 - open->body.size();
      open->body.append(upload, std::min(*upload_size, room));
      *upload_size = 0;
      return MHD_YES;
    }
    return answer(self, *open, path, is_post);
  }

  /// Answers a whole request, or lets it wait.
  static MHD_Result answer(HttpServer& self, Open& open, const char* path, bool is_post) {
    if (!open.answer && open.body.size() > self.most_body_)
      open.answer = refusal(MHD_HTTP_CONTENT_TOO_LARGE, "the body is too long");
    if (!open.answer) {
      HttpRequest request = request_of(open.connection, path);
      request.is_post = is_post;
      request.body = open.body;
      request.number = open.number;
      // Once the server ends, nobody would answer one that waits.
      open.answer =
          self.is_ending_ ? refusal(kUnavailable, "the agent is stopping") : self.answer_(request);
    }
    if (!open.answer) {
      open.waits = true;
      http_library()->suspend_connection(open.connection);
      return MHD_YES;
    }
    open.is_answered = true;
    return send(open.connection, *std::exchange(open.answer, std::nullopt));
  }

  static void connection(void* server, MHD_Connection* connection, void** /*of_connection*/,
                         MHD_ConnectionNotificationCode what) noexcept {
    auto& self = *static_cast<HttpServer*>(server);
    if (what == MHD_CONNECTION_NOTIFY_STARTED) {
      if (self.open_.size() >= kCrowded) {
        const auto slowest = std::ranges::find_if(
            self.open_, [](const Open& open) { return !open.is_shut && !open.waits; });
        if (slowest != self.open_.end()) shut(*slowest, self.closed_.crowded);
      }
      self.open_.push_back({connection, self.now_, ++self.last_number_});
      return;
    }
    const auto found = std::ranges::find(self.open_, connection, &Open::connection);
    if (found == self.open_.end()) return;
    if (!found->is_shut && !found->is_answered) ++self.closed_.unanswered;
    self.open_.erase(found);
  }
};

HttpAnswer json_answer(unsigned status, std::string json) {
  return {status, kJson, std::make_shared<const std::string>(std::move(json)), {}};
}

HttpAnswer refusal(unsigned status, std::string_view why) {
  json::Writer out;
  out.begin_object().key("error").string(why).end_object();
  return json_answer(status, out.take() + "\n");
}

Result<std::unique_ptr<HttpServer>> HttpServer::start(ListeningSocket socket, Answer answer,
                                                      std::size_t most_body) {
  const HttpLibrary* const http = http_library();
  if (http == nullptr)
    return fail(ErrorCode::link_down,
                "libmicrohttpd.so.12 could not be loaded; install the package libmicrohttpd12");
  std::unique_ptr<HttpServer> server(
      new HttpServer(std::move(socket), std::move(answer), most_body));
  // No thread of its own: run() is its loop.
  server->daemon_ = http->start_daemon(
      MHD_USE_EPOLL | MHD_ALLOW_SUSPEND_RESUME, 0, nullptr, nullptr, &Callbacks::request,
      server.get(), MHD_OPTION_LISTEN_SOCKET, static_cast<MHD_socket>(server->socket_.take_file()),
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

HttpServer::HttpServer(ListeningSocket socket, Answer answer, std::size_t most_body)
    : socket_(std::move(socket)), answer_(std::move(answer)), most_body_(most_body) {}

HttpServer::~HttpServer() {
  is_ending_ = true;
  socket_.remove_path();
  if (daemon_ == nullptr) return;
  // The library cannot stop while connections are suspended.
  for (const Open& open : open_)
    if (open.waits) finish(open.number, refusal(kUnavailable, "the agent is stopping"));
  for (int i = 0; i < kLastRuns; ++i) http_library()->run(daemon_);
  http_library()->stop_daemon(daemon_);
}

SteadyTime HttpServer::run(SteadyTime now) {
  const HttpLibrary& http = *http_library();
  now_ = now;
  for (Open& open : open_) {
    if (now < end_of(open)) continue;
    if (open.waits)
      finish(open.number, refusal(kGatewayTimeout, "there is no result yet"));
    else
      shut(open, closed_.slow);
  }
  http.run(daemon_);
  MHD_UNSIGNED_LONG_LONG silence_ms = 0;
  SteadyTime wake = SteadyTime::max();
  if (http.get_timeout(daemon_, &silence_ms) == MHD_YES)
    wake = now + milliseconds(std::min<MHD_UNSIGNED_LONG_LONG>(silence_ms, kMostWaitMs));
  // Connections past their limit were shut and need no wake-up.
  for (const Open& open : open_)
    if (const SteadyTime end = end_of(open); end > now) wake = std::min(wake, end);
  return wake;
}

void HttpServer::finish(std::uint64_t number, HttpAnswer answer) {
  const auto open = std::ranges::find(open_, number, &Open::number);
  if (open == open_.end() || !std::exchange(open->waits, false)) return;
  open->since = now_;  // the time to send it begins now
  open->answer = std::move(answer);
  http_library()->resume_connection(open->connection);
}

SteadyTime HttpServer::end_of(const Open& open) {
  return open.since + (open.waits ? kLongestWait : kLongestConnection);
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
