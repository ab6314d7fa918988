#include "agent/field/transport/serial_driver.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

namespace fxagent::test {
namespace {

namespace fs = std::filesystem;

/// A pty, which has no adapter, and a directory instead of sysfs.
struct LowLatencyTest : ::testing::Test {
  LowLatencyTest() : port(posix_openpt(O_RDWR | O_NOCTTY)) {
    EXPECT_GE(port, 0);
    devices = fs::temp_directory_path() / ("fxagent-sysfs-" + std::to_string(::getpid()));
    struct stat node {};
    EXPECT_EQ(fstat(port, &node), 0);
    timer = devices /
            (std::to_string(major(node.st_rdev)) + ":" + std::to_string(minor(node.st_rdev))) /
            "device" / "latency_timer";
  }
  ~LowLatencyTest() override {
    ::close(port);
    fs::remove_all(devices);
  }

  void write_timer(const std::string& text) const {
    fs::create_directories(timer.parent_path());
    std::ofstream(timer) << text;
  }

  int port;
  fs::path devices;
  fs::path timer;
};

TEST_F(LowLatencyTest, PortWithoutAdapterIsLeftAsItIs) {
  const LowLatency got = ask_for_low_latency(port);
  EXPECT_FALSE(got.flag_taken);
  EXPECT_EQ(got.timer_ms, std::nullopt);
}

TEST_F(LowLatencyTest, TimerOfTheAdapterIsSetToItsLeast) {
  write_timer("16\n");
  EXPECT_EQ(ask_for_low_latency(port, devices).timer_ms, 1);
}

TEST_F(LowLatencyTest, TimerThatSaysNoNumberIsNone) {
  write_timer("what?\n");
  EXPECT_EQ(ask_for_low_latency(port, devices).timer_ms, std::nullopt);
}

TEST_F(LowLatencyTest, ClosedPortIsNoError) {
  const LowLatency got = ask_for_low_latency(-1, devices);
  EXPECT_FALSE(got.flag_taken);
  EXPECT_EQ(got.timer_ms, std::nullopt);
}

}  // namespace
}  // namespace fxagent::test
