#include "agent/config/machine.h"

#include <gtest/gtest.h>
#include <pty.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <filesystem>
#include <string>

#include "tests/support/other_program.h"
#include "tests/support/says.h"
#include "tests/support/scratch.h"

namespace fxagent {
namespace {

using test::OtherProgram;

Config config_with(const std::string& path) {
  Config config;
  config.links.resize(2);
  config.links[0].channel = TcpSettings{};
  config.links[1].channel = SerialSettings{.path = path};
  return config;
}

class Pty final {
 public:
  Pty() { EXPECT_EQ(::openpty(&maker_, &port_, path_.data(), nullptr, nullptr), 0); }
  Pty(const Pty&) = delete;
  Pty& operator=(const Pty&) = delete;
  ~Pty() {
    ::close(port_);
    ::close(maker_);
  }
  std::string path() const { return path_.data(); }
  int maker() const { return maker_; }

 private:
  int maker_ = -1;
  int port_ = -1;
  std::array<char, 64> path_{};
};

TEST(SerialPorts, OneThatIsNotThereIsNamed) {
  const test::Scratch scratch;
  const auto found = unavailable_ports(config_with(scratch.path("ttyNone")), "agent.json");
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].pointer, "/links/1/serial/path");
  test::expect_says(found[0].text, "cannot be opened");
}

TEST(SerialPorts, OneThatAnotherProgramHasIsNamedWithIt) {
  const Pty pty;
  const Config config = config_with(pty.path());
  EXPECT_TRUE(unavailable_ports(config, "agent.json").empty());
  const OtherProgram other(pty.path(), OtherProgram::Holds::open, pty.maker());
  const auto found = unavailable_ports(config, "agent.json");
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].pointer, "/links/1/serial/path");
  test::expect_says(found[0].text, "is in use by another program: config_test, pid " +
                                       std::to_string(other.pid()));
}

TEST(SerialPorts, WhatIsNoPortIsNamed) {
  const test::Scratch scratch;
  const OtherProgram other("/dev/null");
  for (const std::string& path :
       {scratch.write("file", ""), scratch.directory().string(), std::string("/dev/null")}) {
    const auto found = unavailable_ports(config_with(path), "agent.json");
    ASSERT_EQ(found.size(), 1U) << path;
    EXPECT_EQ(found[0].text, path + " is not a serial port");
  }
}

TEST(SerialPorts, OneOfTwoNamesIsNamedAtTheSecondLink) {
  const test::Scratch scratch;
  const Pty pty;
  Config config = config_with(pty.path());
  config.links[1].name = "line1";
  config.links.resize(4);
  config.links[2].channel = SerialSettings{.path = scratch.path("missing1")};
  config.links[3].channel = SerialSettings{.path = scratch.path("by-id")};
  std::filesystem::create_symlink(pty.path(), scratch.path("by-id"));
  const auto found = unavailable_ports(config, "agent.json");
  ASSERT_EQ(found.size(), 2U);
  EXPECT_EQ(found[1].pointer, "/links/3/serial/path");
  test::expect_says(found[1].text, "is also the port of link line1");
}

TEST(SerialPorts, OneDeviceWithTwoNodesIsOnePort) {
  const test::Scratch scratch;
  const Pty pty;
  struct stat port {};
  ASSERT_EQ(::stat(pty.path().c_str(), &port), 0);
  const std::string node = scratch.path("node");
  if (::mknod(node.c_str(), S_IFCHR | 0600, port.st_rdev) != 0)
    GTEST_SKIP() << "this user may not make device nodes";
  Config config = config_with(pty.path());
  config.links[0].channel = SerialSettings{.path = node};
  const auto found = unavailable_ports(config, "agent.json");
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].pointer, "/links/1/serial/path");
  test::expect_says(found[0].text, "is also the port of link ");
}

}  // namespace
}  // namespace fxagent
