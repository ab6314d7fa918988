#include "agent/config/read/metrics.h"

#include <gtest/gtest.h>

#include <string>

#include "tests/agent/config/small_plant.h"

namespace fxagent {
namespace {

using namespace test;

std::string with_listen(const std::string& listen) {
  return changed("/metrics/listen", "\"" + listen + "\"");
}

TEST(MetricsConfig, WithoutTheKeyNoneAreServed) {
  EXPECT_FALSE(good(without("/metrics")).metrics.has_value());
}

TEST(MetricsConfig, AddressesArePartedIntoHostAndPort) {
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
    ASSERT_TRUE(config.metrics.has_value()) << each.listen;
    EXPECT_EQ(config.metrics->address, each.address);
    EXPECT_EQ(config.metrics->port, each.port);
    EXPECT_EQ(config.metrics->unix_path, "");
  }
  EXPECT_EQ(good(with_listen("unix:/run/fxagent/metrics")).metrics->unix_path,
            "/run/fxagent/metrics");
}

TEST(MetricsConfig, WhatIsNoAddressSaysWhatOneLooksLike) {
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

TEST(MetricsConfig, AddressThatOthersReachIsWarnedOf) {
  for (const std::string listen : {"0.0.0.0:9464", "192.0.2.7:9464", "[::]:9464"})
    EXPECT_TRUE(warns(good(with_listen(listen)), {"/metrics/listen", "password", "TLS"})) << listen;
  for (const std::string listen : {"127.0.0.1:9464", "127.1.2.3:1", "[::1]:1", "unix:/run/x"})
    EXPECT_FALSE(warns(good(with_listen(listen)), {"/metrics/listen"})) << listen;
}

}  // namespace
}  // namespace fxagent
