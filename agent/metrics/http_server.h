// A small HTTP server for GET, on libmicrohttpd (http_library.h). Whatever clients do, it takes
// what is set here of connections, memory and time, and answers one request a connection. One
// thread, which runs it as it likes: see run().
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <list>
#include <memory>
#include <string>
#include <string_view>

#include "agent/messages.h"
#include "agent/metrics/listening_socket.h"
#include "protocol/result.h"

struct MHD_Connection;
struct MHD_Daemon;

namespace fxagent {

struct HttpAnswer {
  unsigned status = 200;
  const char* type = "";  ///< Content-Type; a literal
  /// Shared with those who are being sent the same one.
  std::shared_ptr<const std::string> body;
};

class HttpServer final {
 public:
  static constexpr unsigned kMostConnections = 64;
  static constexpr unsigned kMostOfOneAddress = 32;
  /// With more than these open the oldest, which is the slowest, is closed for each new one.
  static constexpr std::size_t kCrowded = 24;
  /// Of a request: line and headers together.
  static constexpr std::size_t kMostHeaderBytes = 8192;
  /// From the accept to the last byte of the answer; and the longest silence in between.
  static constexpr std::chrono::seconds kLongestConnection{10};
  static constexpr std::chrono::seconds kLongestSilence{5};

  /// Connections that were closed before they had their answer, since the start.
  struct Closed {
    std::uint64_t slow = 0;        ///< kLongestConnection was over
    std::uint64_t crowded = 0;     ///< the slowest of more than kCrowded
    std::uint64_t unanswered = 0;  ///< silent, gone, or without a request that is one
  };

  /// Answers GET and HEAD of a path, without its query. Must not throw.
  using Answer = std::function<HttpAnswer(std::string_view path)>;

  /// Takes the socket. Errors: link_down, the library is not there, or does not start.
  static Result<std::unique_ptr<HttpServer>> start(ListeningSocket socket, Answer answer);
  ~HttpServer();
  HttpServer(const HttpServer&) = delete;
  HttpServer& operator=(const HttpServer&) = delete;

  /// Does what is due, without waiting. Returns when it is to be called again at the latest; sooner
  /// where file() can be read.
  SteadyTime run(SteadyTime now);
  int file() const { return file_; }
  const Closed& closed() const { return closed_; }

 private:
  struct Open {
    MHD_Connection* connection = nullptr;
    SteadyTime since{};
    bool is_shut = false;  ///< its end is the library's to notice
    bool is_answered = false;
  };
  struct Callbacks;

  HttpServer(ListeningSocket socket, Answer answer);

  void began(MHD_Connection* connection);
  void answered(MHD_Connection* connection);
  void ended(MHD_Connection* connection);
  /// Counts it where that is news.
  static void shut(Open& open, std::uint64_t& count);

  ListeningSocket socket_;  ///< its file is the library's, and a Unix socket's path this one's
  const Answer answer_;
  MHD_Daemon* daemon_ = nullptr;
  int file_ = -1;
  SteadyTime now_{};      ///< of the last run()
  std::list<Open> open_;  ///< the oldest first
  Closed closed_;
};

}  // namespace fxagent
