#include "agent/field/transport/host_lookup.h"

#include <dlfcn.h>
#include <gtest/gtest.h>
#include <netdb.h>

#include <asio/ip/tcp.hpp>
#include <atomic>
#include <semaphore>
#include <string_view>

#include "tests/agent/field/on_io.h"

namespace {

std::binary_semaphore held_has_begun{0};
std::binary_semaphore held_may_end{0};
std::atomic<int> unwanted_lookups = 0;

}  // namespace

/// Takes the place of the system's lookup for three names: "held.test" is looked up until
/// held_may_end, "unwanted.test" is counted, and "two.test" has the addresses 127.0.0.2 and
/// 127.0.0.1.
extern "C" int getaddrinfo(const char* host, const char* service, const addrinfo* hints,
                           addrinfo** found) {
  using LookUp = int (*)(const char*, const char*, const addrinfo*, addrinfo**);
  static const auto look_up = reinterpret_cast<LookUp>(dlsym(RTLD_NEXT, "getaddrinfo"));
  const std::string_view name = host == nullptr ? "" : host;
  if (name == "held.test") {
    held_has_begun.release();
    held_may_end.acquire();
    return EAI_NONAME;
  }
  if (name == "unwanted.test") ++unwanted_lookups;
  if (name == "unwanted.test") return EAI_NONAME;
  if (name != "two.test") return look_up(host, service, hints, found);
  const int failed = look_up("127.0.0.2", service, hints, found);
  if (failed != 0) return failed;
  addrinfo* last = *found;
  while (last->ai_next != nullptr) last = last->ai_next;
  return look_up("127.0.0.1", service, hints, &last->ai_next);
}

namespace fxagent::test {
namespace {

TEST(SocketFault, NamesWhatToCheck) {
  for (const auto& [error, cure] : {std::pair{asio::error::host_unreachable, "network up"},
                                    std::pair{asio::error::network_unreachable, "network up"},
                                    std::pair{asio::error::no_descriptors, "LimitNOFILE"}}) {
    const std::string why = why_failed(error);
    EXPECT_NE(why.find(cure), std::string::npos) << why;
  }
}

TEST(HostLookup, NameThatWasGivenUpInTheQueueIsNotLookedUp) {
  asio::io_context io;
  const auto find = [&io](const std::string& host, SteadyTime deadline) {
    HostLookup lookup;
    return run_on(io, lookup.find(io.get_executor(), host, "line1", deadline));
  };
  asio::ip::tcp::resolver other(io);
  other.async_resolve("held.test", "", [](const auto&, const auto&) {});
  held_has_begun.acquire();
  EXPECT_FALSE(find("unwanted.test", SteadyTime{}));
  held_may_end.release();
  EXPECT_TRUE(find("localhost", std::chrono::steady_clock::now() + kLimit / 2));
  EXPECT_EQ(unwanted_lookups, 0);
}

}  // namespace
}  // namespace fxagent::test
