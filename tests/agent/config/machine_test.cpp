#include "agent/config/machine.h"

#include <gtest/gtest.h>

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

TEST(SerialPorts, OneThatIsNotThereIsNamed) {
  const test::Scratch scratch;
  const auto found = unavailable_ports(config_with(scratch.path("ttyNone")), "agent.json");
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].pointer, "/links/1/serial/path");
  test::expect_says(found[0].text, "cannot be opened");
}

TEST(SerialPorts, OneThatAnotherProgramHasIsNamedWithIt) {
  const test::Scratch scratch;
  const Config config = config_with(scratch.write("ttyUSB0", ""));
  EXPECT_TRUE(unavailable_ports(config, "agent.json").empty());
  const OtherProgram other(scratch.path("ttyUSB0"));
  const auto found = unavailable_ports(config, "agent.json");
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].pointer, "/links/1/serial/path");
  test::expect_says(found[0].text, "is in use by another program: config_test, pid " +
                                       std::to_string(other.pid()));
}

}  // namespace
}  // namespace fxagent
