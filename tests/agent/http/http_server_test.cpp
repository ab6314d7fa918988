// Single-threaded: the test runs the server and its clients in turn and controls the clock.
#include "agent/http/http_server.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <thread>

#include "tests/agent/http/http_client.h"
#include "tests/support/scratch.h"

namespace fxagent {
namespace {

using namespace test;
using namespace std::chrono_literals;

/// A server on a Unix socket, and its clients.
struct ServedTest : testing::Test {
  void start(HttpServer::Answer answer, std::size_t most_body = 0) {
    HttpConfig config;
    config.unix_path = path_;
    auto socket = ListeningSocket::open(config);
    ASSERT_TRUE(socket.has_value()) << socket.error().text;
    auto server = HttpServer::start(std::move(*socket), std::move(answer), most_body);
    ASSERT_TRUE(server.has_value()) << server.error().text;
    server_ = std::move(*server);
  }

  /// Lets the server do everything that is due. The library advances a connection one step at a
  /// time.
  void run() {
    for (int i = 0; i < 50; ++i) server_->run(now_);
  }
  HttpClient client(std::string_view text = {}) {
    HttpClient made(path_);
    EXPECT_TRUE(made.connected());
    run();
    made.send(text);
    run();
    return made;
  }

  const Scratch scratch_;
  const std::string path_ = scratch_.path("http");
  SteadyTime now_{1h};
  std::unique_ptr<HttpServer> server_;
};

struct HttpServerTest : ServedTest {
  void SetUp() override {
    start([this](const HttpRequest& request) {
      asked_.emplace_back(request.path);
      return HttpAnswer{200, "text/plain", body_};
    });
  }
  void TearDown() override { server_.reset(); }

  std::shared_ptr<const std::string> body_ = std::make_shared<const std::string>("the body\n");
  std::vector<std::string> asked_;
};

constexpr std::string_view kGet = "GET /metrics HTTP/1.1\r\nHost: a\r\n\r\n";

// The next server waits for the path. Its file must outlive the end of the one before.
TEST_F(HttpServerTest, PathIsLeftToTheNextServer) {
  HttpConfig config;
  config.unix_path = path_;
  for (int i = 0; i < 200; ++i) {
    std::optional<ListeningSocket> next;
    std::thread waiting([&] {
      while (!next)
        if (auto opened = ListeningSocket::open(config)) next.emplace(std::move(*opened));
    });
    server_.reset();
    waiting.join();
    ASSERT_TRUE(std::filesystem::exists(path_)) << "after " << i << " servers";
    auto server =
        HttpServer::start(std::move(*next), [](const HttpRequest&) { return HttpAnswer{}; });
    ASSERT_TRUE(server.has_value());
    server_ = std::move(*server);
  }
}

TEST_F(HttpServerTest, GetIsAnsweredAndTheConnectionClosed) {
  HttpClient one = client(kGet);
  EXPECT_EQ(one.status(), 200);
  EXPECT_EQ(one.body(), "the body\n");
  EXPECT_NE(one.heard().find("Connection: close"), std::string::npos) << one.heard();
  EXPECT_NE(one.heard().find("Content-Type: text/plain"), std::string::npos);
  EXPECT_TRUE(one.closed());
  EXPECT_EQ(asked_, std::vector<std::string>{"/metrics"});
}

TEST_F(HttpServerTest, QueryIsNoPartOfThePath) {
  EXPECT_EQ(client("GET /healthz?verbose=1 HTTP/1.0\r\n\r\n").status(), 200);
  EXPECT_EQ(asked_, std::vector<std::string>{"/healthz"});
}

TEST_F(HttpServerTest, HeadHasTheHeadersAlone) {
  HttpClient one = client("HEAD /metrics HTTP/1.1\r\nHost: a\r\n\r\n");
  EXPECT_EQ(one.status(), 200);
  EXPECT_EQ(one.body(), "");
}

TEST_F(HttpServerTest, OtherMethodsAreRefused) {
  for (const std::string method : {"POST", "PUT", "DELETE", "OPTIONS", "TRACE", "get"}) {
    HttpClient one =
        client(method + " /metrics HTTP/1.1\r\nHost: a\r\nContent-Length: 3\r\n\r\nabc");
    EXPECT_EQ(one.status(), 405) << method;
    EXPECT_NE(one.heard().find("Allow: GET, HEAD"), std::string::npos);
    EXPECT_TRUE(one.closed()) << method;
  }
  EXPECT_TRUE(asked_.empty());
}

TEST_F(HttpServerTest, LargeHeadersAreRefused) {
  HttpClient one = client("GET /metrics HTTP/1.1\r\nHost: a\r\nX: " +
                          std::string(2 * HttpServer::kMostHeaderBytes, 'x'));
  EXPECT_NE(one.status(), 200);
  EXPECT_TRUE(one.closed());
  EXPECT_TRUE(asked_.empty());
}

TEST_F(HttpServerTest, OfPipelinedRequestsTheFirstIsAnswered) {
  HttpClient one = client(std::string(kGet) + std::string(kGet) + std::string(kGet));
  EXPECT_EQ(one.body(), "the body\n");
  EXPECT_TRUE(one.closed());
  EXPECT_EQ(asked_.size(), 1U);
}

TEST_F(HttpServerTest, ClientThatHasEndedItsSideGetsItsAnswer) {
  HttpClient one = client();
  one.send(kGet);
  one.end_sending();
  run();
  EXPECT_EQ(one.status(), 200);
  EXPECT_TRUE(one.closed());
}

TEST_F(HttpServerTest, ClientThatEndsWithoutAQuestionIsForgotten) {
  HttpClient one = client("GET /metr");
  one.end_sending();
  run();
  EXPECT_TRUE(one.closed());
  EXPECT_TRUE(asked_.empty());
  EXPECT_EQ(server_->closed().unanswered, 1U);
  EXPECT_EQ(client(kGet).status(), 200);
  EXPECT_EQ(server_->closed().unanswered, 1U) << "one that was answered does not count";
}

TEST_F(HttpServerTest, GarbageIsClosedOrRefused) {
  for (const std::string& text :
       {std::string("\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03\r\n\r\n", 15),
        std::string("GET\r\n\r\n"), std::string("\r\n\r\n\r\n\r\n"),
        std::string("GET /metrics HTTP/9.9\r\n\r\n"), std::string(300, '\0') + "\r\n\r\n"}) {
    HttpClient one = client(text);
    one.end_sending();
    run();
    EXPECT_TRUE(one.closed());
    EXPECT_NE(one.status(), 200) << one.heard();
  }
}

TEST_F(HttpServerTest, SlowSenderIsClosedAfterItsTimeHoweverItDrips) {
  HttpClient slow = client("GET /metrics HTTP/1.1\r\n");
  const SteadyTime begin = now_;
  while (now_ - begin < HttpServer::kLongestConnection - 1s) {
    now_ += 1s;
    slow.send("X: y\r\n");
    run();
    ASSERT_FALSE(slow.closed());
  }
  EXPECT_LE(server_->run(now_), begin + HttpServer::kLongestConnection);
  now_ = begin + HttpServer::kLongestConnection;
  run();
  EXPECT_TRUE(slow.closed());
  EXPECT_EQ(slow.status(), 0);
  EXPECT_EQ(server_->closed().slow, 1U);
  EXPECT_EQ(server_->closed().unanswered, 0U) << "it counts once";
}

TEST_F(HttpServerTest, CrowdOfSlowClientsKeepsNobodyOut) {
  std::vector<HttpClient> slow;
  for (int i = 0; i < 500; ++i) slow.push_back(client("GET /met"));
  EXPECT_EQ(client(kGet).status(), 200);
  std::size_t open = 0;
  for (HttpClient& each : slow) open += each.closed() ? 0U : 1U;
  EXPECT_LE(open, HttpServer::kCrowded);
  EXPECT_EQ(server_->closed().crowded, 501 - HttpServer::kCrowded);
  EXPECT_TRUE(slow.front().closed());
  EXPECT_FALSE(slow.back().closed()) << "the slowest go first";
}

TEST_F(HttpServerTest, CrowdThatComesAtOnceKeepsNobodyOutForLong) {
  std::vector<HttpClient> slow;
  for (int i = 0; i < 60; ++i) {
    slow.emplace_back(path_);
    slow.back().send("GET /met");
  }
  run();
  EXPECT_EQ(client(kGet).status(), 200);
}

TEST_F(HttpServerTest, ReaderThatTakesNothingIsClosedAfterItsTime) {
  body_ = std::make_shared<const std::string>(std::string(std::size_t{8} << 20, 'x'));
  HttpClient lazy(path_);
  run();
  lazy.send(kGet);
  run();
  ASSERT_EQ(body_.use_count(), 2) << "it is being sent";
  now_ += HttpServer::kLongestConnection;
  run();
  EXPECT_EQ(body_.use_count(), 1);
}

TEST_F(HttpServerTest, OneBodyIsSharedByAllWhoAreSentIt) {
  body_ = std::make_shared<const std::string>(std::string(std::size_t{8} << 20, 'x'));
  std::vector<HttpClient> clients;
  for (int i = 0; i < 10; ++i) {
    clients.emplace_back(path_);
    run();
    clients.back().send(kGet);
  }
  run();
  EXPECT_EQ(body_.use_count(), 11);
}

// ---- POST ---------------------------------------------------------------------------------------

struct HttpPostTest : ServedTest {
  static constexpr std::size_t kMostBody = 100;

  void SetUp() override {
    start(
        [this](const HttpRequest& request) -> std::optional<HttpAnswer> {
          bodies_.emplace_back(request.body);
          last_ = request.number;
          if (request.path == "/later") return std::nullopt;
          return HttpAnswer{200, "text/plain", std::make_shared<const std::string>("now")};
        },
        kMostBody);
  }
  void TearDown() override { server_.reset(); }

  HttpClient post(const std::string& path, const std::string& body) {
    HttpClient made = client("POST " + path + " HTTP/1.1\r\nHost: a\r\nContent-Length: " +
                             std::to_string(body.size()) + "\r\n\r\n");
    made.send(body);
    run();
    return made;
  }
  static HttpAnswer late() {
    return {200, "text/plain", std::make_shared<const std::string>("late")};
  }

  std::vector<std::string> bodies_;
  std::uint64_t last_ = 0;
};

TEST_F(HttpPostTest, BodyIsPassedOn) {
  HttpClient one = post("/now", "a body");
  EXPECT_EQ(one.status(), 200);
  EXPECT_EQ(one.body(), "now");
  EXPECT_EQ(bodies_, std::vector<std::string>{"a body"});
  EXPECT_EQ(post("/now", std::string(kMostBody, 'x')).status(), 200);
}

TEST_F(HttpPostTest, TooLongABodyIsRefused) {
  HttpClient one = post("/now", std::string(kMostBody + 1, 'x'));
  EXPECT_EQ(one.status(), 413);
  EXPECT_EQ(post("/now", std::string(100'000, 'x')).status(), 413);
  EXPECT_TRUE(bodies_.empty());
}

TEST_F(HttpPostTest, BodyThatDoesNotEndIsClosed) {
  HttpClient one = client("POST /now HTTP/1.1\r\nHost: a\r\nContent-Length: 50\r\n\r\nabc");
  now_ += HttpServer::kLongestConnection;
  run();
  EXPECT_TRUE(one.closed());
  EXPECT_EQ(server_->closed().slow, 1U);
  EXPECT_TRUE(bodies_.empty());
}

TEST_F(HttpPostTest, AnswerMayComeLater) {
  HttpClient one = post("/later", "x");
  now_ += HttpServer::kLongestConnection * 2;
  run();
  EXPECT_EQ(one.heard(), "");
  EXPECT_FALSE(one.closed());
  server_->finish(last_, late());
  run();
  EXPECT_EQ(one.body(), "late");
  EXPECT_TRUE(one.closed());
  EXPECT_EQ(server_->closed().slow, 0U);
  EXPECT_EQ(bodies_.size(), 1U);
  server_->finish(last_, late());  // nobody waits
}

TEST_F(HttpPostTest, WaitHasAnEnd) {
  HttpClient one = post("/later", "x");
  now_ += HttpServer::kLongestWait;
  run();
  EXPECT_EQ(one.status(), 504);
}

TEST_F(HttpPostTest, EndOfTheServerIsToldToThoseThatWait) {
  HttpClient one = post("/later", "x");
  server_.reset();
  EXPECT_EQ(one.status(), 503);
}

TEST_F(HttpPostTest, RequestThatIsCompleteOnlyDuringTheEndOfTheServerIsRefused) {
  HttpClient one = client("POST /later HTTP/1.1\r\nHost: a\r\nContent-Length: 2\r\n\r\nx");
  one.send("x");
  server_.reset();
  EXPECT_EQ(one.status(), 503);
  EXPECT_TRUE(bodies_.empty());
}

TEST_F(HttpPostTest, CrowdClosesNoneThatWait) {
  HttpClient one = post("/later", "x");
  const std::uint64_t number = last_;
  std::vector<HttpClient> crowd;
  for (std::size_t i = 0; i < HttpServer::kCrowded; ++i) {
    crowd.emplace_back(path_);
    run();
  }
  EXPECT_TRUE(crowd.front().closed());
  server_->finish(number, late());
  run();
  EXPECT_EQ(one.body(), "late");
}

TEST_F(HttpPostTest, FullWhenManyWait) {
  std::vector<HttpClient> waiting;
  for (int i = 0; i < HttpServer::kMostWaiting; ++i) {
    EXPECT_FALSE(server_->is_full());
    waiting.push_back(post("/later", "x"));
  }
  EXPECT_TRUE(server_->is_full());
  server_->finish(last_, late());
  EXPECT_FALSE(server_->is_full());
}

TEST_F(HttpPostTest, ClientThatLeavesWhileItWaitsIsForgotten) {
  { HttpClient one = post("/later", "x"); }
  run();
  server_->finish(last_, late());
  run();
  EXPECT_FALSE(server_->is_full());
  EXPECT_EQ(post("/now", "y").status(), 200);
}

}  // namespace
}  // namespace fxagent
