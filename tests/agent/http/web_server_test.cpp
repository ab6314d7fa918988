// The complete server with a status board filled by the test, over a Unix socket.
#include "agent/http/web_server.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <thread>

#include "tests/agent/http/http_client.h"
#include "tests/agent/http/made_up_status.h"
#include "tests/support/says.h"
#include "tests/support/scratch.h"

namespace fxagent {
namespace {

using namespace test;
using namespace std::chrono_literals;
using nlohmann::json;
using Clock = std::chrono::steady_clock;

struct WebServerTest : testing::Test {
  void SetUp() override { config_.unix_path = scratch_.path("metrics"); }

  void publish(AgentStatus status) {
    const auto now = Clock::now();
    status.made_at = now;
    status.field_heard = now;
    board_.publish(std::make_shared<const AgentStatus>(std::move(status)), now);
  }

  /// Returns the answer, once it has arrived.
  HttpClient ask(const std::string& path, const std::string& host = "a",
                 const std::string& header = "X: y") {
    const auto deadline = Clock::now() + 30s;
    while (Clock::now() < deadline) {
      HttpClient client(config_.unix_path);
      if (client.connected()) {
        client.send("GET " + path + " HTTP/1.1\r\nHost: " + host + "\r\n" + header + "\r\n\r\n");
        while (!client.closed() && Clock::now() < deadline) std::this_thread::sleep_for(1ms);
        return client;
      }
      std::this_thread::sleep_for(1ms);
    }
    ADD_FAILURE() << "nobody listens";
    return HttpClient(config_.unix_path);
  }

  const Scratch scratch_;
  HttpConfig config_;
  StatusBoard board_{[] {}};
};

TEST_F(WebServerTest, EachPathHasItsAnswer) {
  publish(ready_status());
  const WebServer server(config_, board_);
  HttpClient metrics = ask("/metrics");
  EXPECT_EQ(metrics.status(), 200);
  expect_says(metrics.heard(), "text/plain; version=0.0.4");
  expect_says(metrics.body(), "\nfxagent_exchanges_total{link=\"line1\"} 9642\n");
  for (const std::string path : {"/healthz", "/readyz"}) {
    HttpClient probe = ask(path);
    EXPECT_EQ(probe.status(), 200) << path;
    EXPECT_EQ(json::parse(probe.body()).at("ok"), true);
  }
  HttpClient none = ask("/");
  EXPECT_EQ(none.status(), 404);
  expect_says(none.body(), "/metrics");
}

TEST_F(WebServerTest, PageIsServedOnlyIfTheConfigSaysSo) {
  config_.page = true;
  publish(made_up_status());
  const WebServer server(config_, board_);
  HttpClient page = ask("/", "127.0.0.1");
  EXPECT_EQ(page.status(), 200);
  expect_says(page.heard(), "text/html");
  expect_says(page.heard(), "require-trusted-types-for 'script'");
  EXPECT_EQ(ask("/app.js", "127.0.0.1").status(), 200);
  for (const std::string path : {"/..", "/../app.js", "/%2e%2e/app.js", "/app.js/", "//app.js",
                                 "/page/app.js", "/api", "/api/"})
    EXPECT_EQ(ask(path, "127.0.0.1").status(), 404) << path;
  EXPECT_EQ(ask("/metrics").status(), 200) << "of any name";
}

TEST_F(WebServerTest, APageThatTheBrowserHasIsNotSentAgain) {
  config_.page = true;
  publish(made_up_status());
  const WebServer server(config_, board_);
  const std::string heard = ask("/style.css", "localhost").heard();
  const std::size_t tag = heard.find("ETag: ") + 6;
  HttpClient again = ask("/style.css", "localhost",
                         "If-None-Match: " + heard.substr(tag, heard.find('\r', tag) - tag));
  EXPECT_EQ(again.status(), 304);
  EXPECT_EQ(again.body(), "");
}

TEST_F(WebServerTest, NoOtherNameReachesThePage) {
  config_.page = true;
  config_.hosts = {"edge7.plant.example"};
  publish(made_up_status());
  const WebServer server(config_, board_);
  for (const std::string host : {"127.0.0.1", "127.0.0.1:8080", "[::1]:8080", "[::1]", "localhost",
                                 "LOCALHOST:1", "edge7.plant.example", "EDGE7.plant.example:443"})
    EXPECT_EQ(ask("/", host).status(), 200) << host;
  for (const std::string host : {"evil.example", "127.0.0.1.evil.example", "localhost.evil.example",
                                 "evil.example:8080", "edge7.plant.example.evil", "1e3.example"})
    for (const std::string path : {"/", "/api/config", "/api/changes", "/app.js"})
      EXPECT_EQ(ask(path, host).status(), 421) << host;
}

TEST_F(WebServerTest, WithoutAFreshStatusThePageHasNoData) {
  config_.page = true;
  const WebServer server(config_, board_);
  EXPECT_EQ(ask("/", "localhost").status(), 200);
  HttpClient data = ask("/api/changes?since=0", "localhost");
  EXPECT_EQ(data.status(), 503);
  expect_says(data.body(), "no sign of life");
}

TEST_F(WebServerTest, WithoutAStatusThereAreNoMetrics) {
  const WebServer server(config_, board_);
  for (const std::string path : {"/healthz", "/readyz", "/metrics"}) {
    HttpClient probe = ask(path);
    EXPECT_EQ(probe.status(), 503) << path;
    EXPECT_EQ(json::parse(probe.body()).at("ok"), false);
  }
}

TEST_F(WebServerTest, AgentWithoutABrokerIsHealthyAndNotReady) {
  AgentStatus status = made_up_status();
  status.broker = {"mqtt://one:1883", false, false};
  publish(std::move(status));
  const WebServer server(config_, board_);
  EXPECT_EQ(ask("/healthz").status(), 200);
  HttpClient ready = ask("/readyz");
  EXPECT_EQ(ready.status(), 503);
  expect_says(ready.body(), "no connection to mqtt://one:1883");
}

TEST_F(WebServerTest, NewStatusIsShown) {
  publish(made_up_status());
  const WebServer server(config_, board_);
  ask("/metrics");
  AgentStatus status = made_up_status();
  status.store_bytes = 4711;
  publish(std::move(status));
  expect_says(ask("/metrics").body(), "\nfxagent_store_bytes 4711\n");
}

TEST_F(WebServerTest, AddressThatIsTakenIsTakenOverOnceItIsFree) {
  publish(made_up_status());
  auto other = std::make_unique<ListeningSocket>(*ListeningSocket::open(config_));
  const WebServer server(config_, board_);
  HttpClient waiting(config_.unix_path);
  EXPECT_TRUE(waiting.connected()) << "to the other one";
  other.reset();
  EXPECT_EQ(ask("/healthz").status(), 200);
}

TEST_F(WebServerTest, EndsAtOnceWhereTheAddressIsTaken) {
  const auto other = ListeningSocket::open(config_);
  ASSERT_TRUE(other.has_value());
  const auto began = Clock::now();
  { const WebServer server(config_, board_); }
  EXPECT_LT(Clock::now() - began, WebServer::kRetry);
}

}  // namespace
}  // namespace fxagent
