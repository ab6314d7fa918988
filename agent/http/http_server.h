// A small HTTP server for GET and HEAD, on libmicrohttpd (http_library.h). Limits connections,
// memory and time, whatever clients do. Answers one request per connection. One thread, which
// drives it: see run().
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <list>
#include <map>
#include <memory>
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
inline constexpr unsigned kNotFound = 404;

/// The parts of a request that answers depend on. The views are valid during the call.
struct HttpRequest {
  std::string_view path;           ///< decoded, without the query
  std::string_view host;           ///< Host, as sent; empty: none
  std::string_view if_none_match;  ///< If-None-Match; empty: none
  /// Decoded arguments of the query; of an argument given twice, the first.
  std::map<std::string_view, std::string_view> arguments{};
};

struct HttpAnswer {
  unsigned status = 200;
  const char* type = "";  ///< Content-Type; a literal
  /// Shared by all connections that are being sent the same body.
  std::shared_ptr<const std::string> body;
  std::string etag{};  ///< ETag with its quotes; empty: none
};

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

  /// Connections that were closed before they had their answer, since the start.
  struct Closed {
    std::uint64_t slow = 0;        ///< open longer than kLongestConnection
    std::uint64_t crowded = 0;     ///< the oldest of more than kCrowded
    std::uint64_t unanswered = 0;  ///< silent, gone, or without a valid request
  };

  /// Answers GET and HEAD. Must not throw.
  using Answer = std::function<HttpAnswer(const HttpRequest& request)>;

  /// Takes over the socket. Errors: link_down if the library is missing or does not start.
  static Result<std::unique_ptr<HttpServer>> start(ListeningSocket socket, Answer answer);
  ~HttpServer();
  HttpServer(const HttpServer&) = delete;
  HttpServer& operator=(const HttpServer&) = delete;

  /// Does the work that is due, without waiting. Call it again by the time it returns, or earlier
  /// if file() becomes readable.
  SteadyTime run(SteadyTime now);
  int file() const { return file_; }
  const Closed& closed() const { return closed_; }

 private:
  struct Open {
    MHD_Connection* connection = nullptr;
    SteadyTime since{};
    bool is_shut = false;  ///< shut down; the library will notice
    bool is_answered = false;
  };
  struct Callbacks;

  HttpServer(ListeningSocket socket, Answer answer);

  void began(MHD_Connection* connection);
  void answered(MHD_Connection* connection);
  void ended(MHD_Connection* connection);
  /// Shuts a connection down and counts it, once.
  static void shut(Open& open, std::uint64_t& count);

  ListeningSocket socket_;  ///< owns a Unix socket's path; the library owns the file
  const Answer answer_;
  MHD_Daemon* daemon_ = nullptr;
  int file_ = -1;
  SteadyTime now_{};      ///< of the last run()
  std::list<Open> open_;  ///< oldest first
  Closed closed_;
};

}  // namespace fxagent
