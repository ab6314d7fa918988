// A small HTTP server for GET, HEAD and short POSTs, on libmicrohttpd, which is loaded on demand.
// Limits connections, memory and time, whatever clients do. Answers one request per connection. One
// thread, which drives it: see run().
#pragma once

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <list>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "agent/http/listening_socket.h"
#include "agent/steady_time.h"
#include "protocol/value/result.h"

struct MHD_Connection;
struct MHD_Daemon;

namespace fxagent {

inline constexpr const char* kJson = "application/json";
inline constexpr unsigned kOk = 200;
inline constexpr unsigned kNotModified = 304;
inline constexpr unsigned kBadRequest = 400;
inline constexpr unsigned kNotFound = 404;
inline constexpr unsigned kNotAllowed = 405;
inline constexpr unsigned kUnavailable = 503;

/// The parts of a request that answers depend on. The views are valid during the call.
struct HttpRequest {
  std::string_view path;           ///< decoded, without the query
  std::string_view host;           ///< Host, as sent; empty: none
  std::string_view if_none_match;  ///< If-None-Match; empty: none
  /// Decoded arguments of the query; of an argument given twice, the first.
  std::map<std::string_view, std::string_view> arguments{};
  // The rest is for POST.
  bool is_post = false;
  std::string_view body{};
  std::string_view authorization{};
  std::string_view origin{};      ///< Origin; empty: none, so no browser sent it
  std::string_view fetch_site{};  ///< Sec-Fetch-Site; empty: none
  std::uint64_t number = 0;       ///< for HttpServer::finish()
};

struct HttpAnswer {
  unsigned status = 200;
  const char* type = "";  ///< Content-Type; a literal
  /// Never null. Shared by all connections that are being sent the same body.
  std::shared_ptr<const std::string> body;
  std::string etag{};  ///< ETag with its quotes; empty: none
};

/// Returns an answer with this JSON, which is sent as it is.
HttpAnswer json_answer(unsigned status, std::string json);
/// Returns an answer with `why` as JSON: {"error": "..."}.
HttpAnswer refusal(unsigned status, std::string_view why);

class HttpServer final {
 public:
  static constexpr unsigned kMostConnections = 64;
  static constexpr unsigned kMostOfOneAddress = 32;
  /// Above this many open connections, each new one closes the oldest, which is the slowest.
  static constexpr std::size_t kCrowded = 24;
  /// Request line and headers together.
  static constexpr std::size_t kMostHeaderBytes = 8192;
  /// Longest time from accept to the last byte of the answer, and longest silence in between.
  static constexpr std::chrono::seconds kLongestConnection{10};
  static constexpr std::chrono::seconds kLongestSilence{5};
  /// Most requests that wait for a later answer (see is_full()), and the longest wait of one.
  static constexpr std::ptrdiff_t kMostWaiting = 16;
  static constexpr std::chrono::seconds kLongestWait{120};

  /// Connections that were closed before they had their answer, since the start.
  struct Closed {
    std::uint64_t slow = 0;        ///< open longer than kLongestConnection
    std::uint64_t crowded = 0;     ///< the oldest of more than kCrowded
    std::uint64_t unanswered = 0;  ///< silent, gone, or without a valid request
  };

  /// Must not throw. nullopt: finish() gives the answer later.
  /// Return nullopt only while is_full() is false: the server does not enforce kMostWaiting.
  using Answer = std::function<std::optional<HttpAnswer>(const HttpRequest& request)>;

  /// Takes over the socket. A POST with a longer body than `most_body` gets 413; with 0 every POST
  /// gets 405. Errors: link_down if the library is missing or does not start.
  static Result<std::unique_ptr<HttpServer>> start(ListeningSocket socket, Answer answer,
                                                   std::size_t most_body = 0);
  /// Answers 503 to the requests that wait.
  ~HttpServer();
  HttpServer(const HttpServer&) = delete;
  HttpServer& operator=(const HttpServer&) = delete;

  /// Does the work that is due, without waiting. Call it again by the time it returns, or earlier
  /// if file() becomes readable.
  SteadyTime run(SteadyTime now);
  int file() const { return file_; }
  /// Answers the request of this number, if its client still waits. Call run() next.
  void finish(std::uint64_t number, HttpAnswer answer);
  /// True if no more answers can come later.
  bool is_full() const { return std::ranges::count_if(open_, &Open::waits) >= kMostWaiting; }
  const Closed& closed() const { return closed_; }

 private:
  struct Open {
    MHD_Connection* connection = nullptr;
    SteadyTime since{};
    std::uint64_t number = 0;
    bool is_shut = false;  ///< shut down; the library will notice
    bool is_answered = false;
    bool has_begun = false;              ///< its headers have come
    bool waits = false;                  ///< its answer comes later
    std::string body{};                  ///< of a POST; at most one byte too long
    std::optional<HttpAnswer> answer{};  ///< came later
  };
  struct Callbacks;

  HttpServer(ListeningSocket socket, Answer answer, std::size_t most_body);

  static SteadyTime end_of(const Open& open);
  /// Shuts a connection down and counts it, once.
  static void shut(Open& open, std::uint64_t& count);

  ListeningSocket socket_;  ///< owns a Unix socket's path; the library owns the file
  const Answer answer_;
  bool is_ending_ = false;
  const std::size_t most_body_;
  MHD_Daemon* daemon_ = nullptr;
  int file_ = -1;
  SteadyTime now_{};      ///< of the last run()
  std::list<Open> open_;  ///< oldest first
  std::uint64_t last_number_ = 0;
  Closed closed_;
};

}  // namespace fxagent
