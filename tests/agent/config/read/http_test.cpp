#include "agent/config/read/sections.h"

#include <gtest/gtest.h>

#include "tests/agent/config/small_plant.h"

namespace fxagent {
namespace {

using namespace test;

std::string with_listen(const std::string& listen) {
  return changed("/metrics/listen", "\"" + listen + "\"");
}

TEST(HttpConfig, WithoutTheKeyNoneAreServed) {
  EXPECT_FALSE(good(without("/metrics")).http.has_value());
}

TEST(HttpConfig, AddressesArePartedIntoHostAndPort) {
  struct Case {
    std::string listen;
    std::string address;
    std::uint16_t port;
  };
  for (const Case& each :
       {Case{"127.0.0.1:9464", "127.0.0.1", 9464}, Case{"[::1]:9464", "::1", 9464},
        Case{"127.0.0.1:0", "127.0.0.1", 0}, Case{"localhost:1", "127.0.0.1", 1},
        Case{"192.0.2.7:65535", "192.0.2.7", 65535}}) {
    const Config config = good(with_listen(each.listen));
    ASSERT_TRUE(config.http.has_value()) << each.listen;
    EXPECT_EQ(config.http->address, each.address);
    EXPECT_EQ(config.http->port, each.port);
    EXPECT_EQ(config.http->unix_path, "");
  }
  EXPECT_EQ(good(with_listen("unix:/run/fxagent/metrics")).http->unix_path, "/run/fxagent/metrics");
}

TEST(HttpConfig, WhatIsNoAddressSaysWhatOneLooksLike) {
  const std::string place = "/metrics/listen";
  for (const std::string listen : {"9464", "127.0.0.1", "[::1", "[]:9464", "::1:9464"})
    expect_error(with_listen(listen), place, {"127.0.0.1:9464", "[::1]:9464", "unix:/"});
  expect_error(with_listen("plc.example:9464"), place,
               {"127.0.0.1:9464", "a host name is not possible here"});
  expect_error(with_listen(":9464"), place, {"needs an address", "127.0.0.1", "0.0.0.0"});
  for (const std::string listen : {"127.0.0.1:", "127.0.0.1:65536", "127.0.0.1:x", "127.0.0.1:-1"})
    expect_error(with_listen(listen), place, {"port from 0 to 65535"});
  expect_error(with_listen("unix:run/metrics"), place, {"whole path"});
  expect_error(with_listen("unix:/" + std::string(107, 'a')), place, {"108 bytes", "107"});
}

TEST(HttpConfig, AddressThatOthersReachIsWarnedOf) {
  for (const std::string listen : {"0.0.0.0:9464", "192.0.2.7:9464", "[::]:9464"})
    EXPECT_TRUE(warns(good(with_listen(listen)), {"/metrics/listen", "password", "TLS"})) << listen;
  for (const std::string listen : {"127.0.0.1:9464", "127.1.2.3:1", "[::1]:1", "unix:/run/x"})
    EXPECT_FALSE(warns(good(with_listen(listen)), {"/metrics/listen"})) << listen;
}

/// The small plant with the section `http` in place of `metrics`.
std::string with_http(const std::string& members) {
  std::string text = without("/metrics");
  return text.insert(text.find('{') + 1, "\"http\": {" + members + "},");
}

TEST(HttpConfig, OnlyTheSectionHttpServesThePage) {
  EXPECT_FALSE(good(with_listen("127.0.0.1:9464")).http->page);
  const Config config =
      good(with_http(R"("listen": "127.0.0.1:8080", "hosts": ["Edge7.plant.example"])"));
  ASSERT_TRUE(config.http.has_value());
  EXPECT_TRUE(config.http->page);
  EXPECT_EQ(config.http->port, 8080);
  EXPECT_EQ(config.http->hosts, std::vector<std::string>{"Edge7.plant.example"});
}

TEST(HttpConfig, BothSectionsAreAnError) {
  std::string text = with_listen("127.0.0.1:9464");
  text.insert(text.find('{') + 1, R"("http": {"listen": "127.0.0.1:8080"},)");
  expect_error(text, "/metrics", {"http", "remove this one"});
}

TEST(HttpConfig, AHostIsANameAlone) {
  for (const std::string host : {"http://edge7", "edge7:80", "", "edge7/page"})
    expect_error(with_http(R"("listen": "127.0.0.1:8080", "hosts": [")" + host + "\"]"),
                 "/http/hosts/0", {host.empty() ? "empty" : "name alone"});
  EXPECT_TRUE(warns(good(with_http(R"("listen": "0.0.0.0:8080")")), {"/http/listen", "password"}));
}

}  // namespace
}  // namespace fxagent
