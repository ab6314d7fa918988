// The serial ports of a machine, found in /dev and /sys.
#include "agent/cli/setup/init_machine.h"

#include <gtest/gtest.h>

#include <fstream>

#include "tests/support/scratch.h"

namespace fxagent {
namespace {

namespace fs = std::filesystem;

struct FoundPorts : testing::Test {
  /// Adds a port to /dev and /sys; `kind` is Linux's name for a PC's built-in ports.
  void add(const std::string& name, const std::string& kind = {}, bool hardware = true) {
    fs::create_directories(root() / "sys/class/tty" / name);
    if (hardware) fs::create_directories(root() / "sys/class/tty" / name / "device");
    if (!kind.empty()) std::ofstream(root() / "sys/class/tty" / name / "type") << kind << '\n';
    fs::create_directories(root() / "dev");
    std::ofstream(root() / "dev" / name) << "";
  }
  std::vector<std::string> found() const {
    std::vector<std::string> lines;
    for (const FoundPort& port : found_serial_ports(root()))
      lines.push_back(port.path + "|" + port.note);
    return lines;
  }
  const fs::path& root() const { return scratch_.directory(); }

 private:
  const test::Scratch scratch_;
};

TEST_F(FoundPorts, AdaptersGoFirstUnderTheNameThatStays) {
  add("ttyS0", "4");
  add("ttyUSB0");
  add("ttyUSB1");
  fs::create_directories(root() / "dev/serial/by-id");
  fs::create_symlink("../../ttyUSB1",
                     root() / "dev/serial/by-id/usb-FTDI_FT232R_A50285BI-if00-port0");
  fs::create_symlink("../../ttyUSB9", root() / "dev/serial/by-id/usb-gone");
  EXPECT_EQ(found(), (std::vector<std::string>{
                         "/dev/serial/by-id/usb-FTDI_FT232R_A50285BI-if00-port0|ttyUSB1",
                         "/dev/ttyS0|", "/dev/ttyUSB0|"}));
}

TEST_F(FoundPorts, PlacesWithoutHardwareAreNone) {
  add("ttyS0", "0");
  add("ttyS1", "4");
  add("tty1", {}, /*hardware=*/false);
  EXPECT_EQ(found(), std::vector<std::string>{"/dev/ttyS1|"});
}

TEST_F(FoundPorts, AMachineWithoutAnyHasNone) { EXPECT_TRUE(found().empty()); }

}  // namespace
}  // namespace fxagent
