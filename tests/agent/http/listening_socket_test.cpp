#include "agent/http/listening_socket.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "tests/support/says.h"
#include "tests/support/scratch.h"

namespace fxagent {
namespace {

HttpConfig tcp(const std::string& address, std::uint16_t port) {
  HttpConfig config;
  config.address = address;
  config.port = port;
  return config;
}

struct UnixSocket : testing::Test {
  void SetUp() override { config_.unix_path = scratch_.path("metrics"); }

  const test::Scratch scratch_;
  HttpConfig config_;
};

TEST(ListeningSocket, FreePortIsNamed) {
  const auto made = ListeningSocket::open(tcp("127.0.0.1", 0));
  ASSERT_TRUE(made.has_value()) << made.error().text;
  EXPECT_TRUE(made->address().starts_with("127.0.0.1:"));
  EXPECT_FALSE(made->address().ends_with(":0"));
}

TEST(ListeningSocket, AddressThatIsTakenIsSaidWithTheCure) {
  const auto first = ListeningSocket::open(tcp("127.0.0.1", 0));
  ASSERT_TRUE(first.has_value());
  const auto port = std::stoi(first->address().substr(first->address().rfind(':') + 1));
  const auto error =
      test::error_of(ListeningSocket::open(tcp("127.0.0.1", static_cast<std::uint16_t>(port))));
  test::expect_says(error.text, first->address());
  test::expect_says(error.text, "another program");
}

TEST(ListeningSocket, AddressOfAnotherMachineIsSaidWithTheCure) {
  test::expect_says(test::error_of(ListeningSocket::open(tcp("192.0.2.7", 0))).text,
                    "does not have this address");
}

TEST_F(UnixSocket, IsForTheUserAndTheGroupAndGoesWithItsOwner) {
  {
    const auto made = ListeningSocket::open(config_);
    ASSERT_TRUE(made.has_value()) << made.error().text;
    EXPECT_EQ(made->address(), "unix:" + config_.unix_path);
    struct stat file {};
    ASSERT_EQ(::stat(config_.unix_path.c_str(), &file), 0);
    EXPECT_EQ(file.st_mode & 0777U, 0660U);
  }
  EXPECT_FALSE(std::filesystem::exists(config_.unix_path));
}

TEST_F(UnixSocket, FileThatADeadAgentLeftIsReplaced) {
  auto dead = ListeningSocket::open(config_);
  ASSERT_TRUE(dead.has_value());
  ::close(dead->take_file());  // leaves its file behind
  const auto next = ListeningSocket::open(config_);
  ASSERT_TRUE(next.has_value()) << next.error().text;
}

TEST_F(UnixSocket, OneThatIsServedIsNotTaken) {
  const auto first = ListeningSocket::open(config_);
  ASSERT_TRUE(first.has_value());
  test::expect_says(test::error_of(ListeningSocket::open(config_)).text, "another program");
  EXPECT_TRUE(std::filesystem::exists(config_.unix_path)) << "the first one's file";
}

TEST_F(UnixSocket, FileThatIsNoSocketIsLeftAlone) {
  std::ofstream(config_.unix_path) << "mine";
  EXPECT_FALSE(ListeningSocket::open(config_).has_value());
  EXPECT_TRUE(std::filesystem::is_regular_file(config_.unix_path));
}

TEST_F(UnixSocket, DirectoryThatIsNotThereIsSaidWithTheCure) {
  config_.unix_path = scratch_.path("none/metrics");
  test::expect_says(test::error_of(ListeningSocket::open(config_)).text, "create the directory");
}

}  // namespace
}  // namespace fxagent
