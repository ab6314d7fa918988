// The complete server with a status board filled by the test, over a Unix socket.
#include "agent/http/metrics_server.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>
#include <thread>

#include "tests/agent/http/http_client.h"
#include "tests/agent/http/made_up_status.h"
#include "tests/support/scratch.h"

namespace fxagent {
namespace {

using namespace test;
using namespace std::chrono_literals;
using nlohmann::json;
using Clock = std::chrono::steady_clock;

class MetricsServerTest : public testing::Test {
 protected:
  void SetUp() override { config_.unix_path = scratch_.path("metrics"); }

  void publish(AgentStatus status) {
    const auto now = Clock::now();
    status.made_at = now;
    status.field_heard = now;
    board_.publish(std::make_shared<const AgentStatus>(std::move(status)), now);
  }

  /// Returns the answer, once it has arrived.
  HttpClient ask(const std::string& path) {
    const auto deadline = Clock::now() + 30s;
    while (Clock::now() < deadline) {
      HttpClient client(config_.unix_path);
      if (client.connected()) {
        client.send("GET " + path + " HTTP/1.1\r\nHost: a\r\n\r\n");
        while (!client.closed() && Clock::now() < deadline) std::this_thread::sleep_for(1ms);
        return client;
      }
      std::this_thread::sleep_for(1ms);
    }
    ADD_FAILURE() << "nobody listens";
    return HttpClient(config_.unix_path);
  }

  const Scratch scratch_;
  MetricsConfig config_;
  StatusBoard board_{[] {}};
};

TEST_F(MetricsServerTest, EachPathHasItsAnswer) {
  publish(made_up_status());
  const MetricsServer server(config_, board_);
  HttpClient metrics = ask("/metrics");
  EXPECT_EQ(metrics.status(), 200);
  EXPECT_NE(metrics.heard().find("text/plain; version=0.0.4"), std::string::npos);
  EXPECT_NE(metrics.body().find("\nfxagent_exchanges_total{link=\"line1\"} 9642\n"),
            std::string::npos);
  for (const std::string path : {"/healthz", "/readyz"}) {
    HttpClient probe = ask(path);
    EXPECT_EQ(probe.status(), 200) << path;
    EXPECT_EQ(json::parse(probe.body()).at("ok"), true);
  }
  HttpClient none = ask("/");
  EXPECT_EQ(none.status(), 404);
  EXPECT_NE(none.body().find("/metrics"), std::string::npos);
}

TEST_F(MetricsServerTest, WithoutAStatusThereAreNoMetrics) {
  const MetricsServer server(config_, board_);
  for (const std::string path : {"/healthz", "/readyz", "/metrics"}) {
    HttpClient probe = ask(path);
    EXPECT_EQ(probe.status(), 503) << path;
    EXPECT_EQ(json::parse(probe.body()).at("ok"), false);
  }
}

TEST_F(MetricsServerTest, AgentWithoutABrokerIsHealthyAndNotReady) {
  AgentStatus status = made_up_status();
  status.broker = {"mqtt://one:1883", false, false};
  publish(std::move(status));
  const MetricsServer server(config_, board_);
  EXPECT_EQ(ask("/healthz").status(), 200);
  HttpClient ready = ask("/readyz");
  EXPECT_EQ(ready.status(), 503);
  EXPECT_NE(ready.body().find("no connection to mqtt://one:1883"), std::string::npos);
}

TEST_F(MetricsServerTest, NewStatusIsShown) {
  publish(made_up_status());
  const MetricsServer server(config_, board_);
  ask("/metrics");
  AgentStatus status = made_up_status();
  status.store_bytes = 4711;
  publish(std::move(status));
  EXPECT_NE(ask("/metrics").body().find("\nfxagent_store_bytes 4711\n"), std::string::npos);
}

TEST_F(MetricsServerTest, AddressThatIsTakenIsTakenOverOnceItIsFree) {
  publish(made_up_status());
  auto other = std::make_unique<ListeningSocket>(*ListeningSocket::open(config_));
  const MetricsServer server(config_, board_);
  HttpClient waiting(config_.unix_path);
  EXPECT_TRUE(waiting.connected()) << "to the other one";
  other.reset();
  EXPECT_EQ(ask("/healthz").status(), 200);
}

TEST_F(MetricsServerTest, EndsAtOnceWhereTheAddressIsTaken) {
  const auto other = ListeningSocket::open(config_);
  ASSERT_TRUE(other.has_value());
  const auto began = Clock::now();
  { const MetricsServer server(config_, board_); }
  EXPECT_LT(Clock::now() - began, MetricsServer::kRetry);
}

}  // namespace
}  // namespace fxagent
