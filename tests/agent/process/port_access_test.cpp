#include "agent/process/port_access.h"

#include <fcntl.h>
#include <grp.h>
#include <gtest/gtest.h>
#include <pty.h>
#include <sys/file.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <filesystem>
#include <fstream>

#include "tests/support/other_program.h"
#include "tests/support/says.h"
#include "tests/support/scratch.h"

namespace fxagent {
namespace {

namespace fs = std::filesystem;
using test::OtherProgram;

/// A pseudo-terminal with a name in its own directory.
struct PortAccess : testing::Test {
  PortAccess() {
    std::array<char, 64> name{};
    EXPECT_EQ(::openpty(&maker, &own, name.data(), nullptr, nullptr), 0);
    fs::create_symlink(name.data(), port);
  }
  ~PortAccess() override {
    ::close(own);
    ::close(maker);
  }

  const fs::path& directory() const { return scratch_.directory(); }
  std::string scratch_file(const char* name) const { return scratch_.write(name, ""); }

 private:
  const test::Scratch scratch_;

 protected:
  const std::string port = scratch_.path("ttyUSB0");
  int maker = -1;
  int own = -1;  ///< this process has the port open
};

TEST_F(PortAccess, WhoHasItOpenIsFoundByWhateverNameItWasOpened) {
  EXPECT_FALSE(port_holder(port)) << "this process does not count";
  const std::string by_id = (directory() / "by-id").string();
  fs::create_symlink("ttyUSB0", by_id);
  const OtherProgram other(by_id, OtherProgram::Holds::open, maker);
  for (const std::string& name : {port, by_id}) {
    const auto holder = port_holder(name);
    ASSERT_TRUE(holder) << name;
    EXPECT_EQ(holder->pid, other.pid());
    EXPECT_TRUE(holder->program.starts_with("core_test")) << holder->program;
  }
  EXPECT_EQ(port_cure(port, EBUSY), " (another program uses it: " + port_holder(port)->program +
                                        ", pid " + std::to_string(other.pid()) +
                                        "; end it, or use another port)");
  EXPECT_EQ(port_cure(port, EWOULDBLOCK), port_cure(port, EBUSY));
}

TEST_F(PortAccess, TheMakerOfAPseudoTerminalIsNoHolder) {
  {
    const OtherProgram both(port);  // has both ends, as this process does
    EXPECT_FALSE(port_holder(port));
  }
  {
    const OtherProgram user(port, OtherProgram::Holds::open, maker);
    EXPECT_EQ(port_holder(port).value().pid, user.pid());
  }
}

TEST_F(PortAccess, WhatCannotBeAPortHasNoHolder) {
  const std::string file = scratch_file("file");
  const OtherProgram of_file(file);
  const OtherProgram of_null("/dev/null");
  for (const std::string& path : {file, directory().string(), std::string("/dev/null")}) {
    EXPECT_TRUE(is_no_port(path)) << path;
    EXPECT_FALSE(port_holder(path)) << path;
  }
  for (const std::string& path : {port, (directory() / "missing").string()})
    EXPECT_FALSE(is_no_port(path)) << path;
}

TEST_F(PortAccess, APortThatAnotherLinkOfThisProcessLockedIsNotBlamedOnAProgram) {
  ASSERT_EQ(::flock(own, LOCK_EX), 0);
  EXPECT_FALSE(port_holder(port));
  test::expect_says(
      port_cure(port, EWOULDBLOCK),
      "(another link of this agent uses this device, as " + fs::read_symlink(port).string());
}

TEST_F(PortAccess, APortThatAnotherLinkLockedByAnotherNodeIsNotBlamedOnAProgram) {
  struct stat device {};
  ASSERT_EQ(::stat(port.c_str(), &device), 0);
  const std::string node = (directory() / "node").string();
  if (::mknod(node.c_str(), S_IFCHR | 0600, device.st_rdev) != 0)
    GTEST_SKIP() << "this user may not make device nodes";
  ASSERT_EQ(::flock(own, LOCK_EX), 0);
  test::expect_says(port_cure(node, EBUSY), "(another link of this agent uses this device, as " +
                                                fs::read_symlink(port).string());
}

TEST_F(PortAccess, WhatAProgramWasCalledWithIsFoundUnderAnyName) {
  const OtherProgram other(port);
  const std::string link = (directory() / "link").string();
  fs::create_symlink(fs::read_symlink("/proc/self/exe"), link);
  EXPECT_TRUE(is_called_with(other.pid(), "/proc/self/exe"));
  EXPECT_TRUE(is_called_with(other.pid(), link));
  EXPECT_FALSE(is_called_with(other.pid(), port)) << "it has it open, and not as an argument";
  EXPECT_FALSE(is_called_with(other.pid(), (directory() / "none").string()));
}

TEST_F(PortAccess, AProcessIsFoundByItsNameAndNamesItsFiles) {
  std::ifstream arguments("/proc/self/cmdline", std::ios::binary);
  std::string word;
  std::getline(arguments, word, '\0');
  // A name of its own, which the other program inherits; tests of this program may run in parallel.
  const std::string name = "t" + std::to_string(::getpid());
  ASSERT_EQ(::prctl(PR_SET_NAME, name.c_str()), 0);
  EXPECT_TRUE(processes_called(name, word).empty()) << "this process does not count";
  const OtherProgram other(port);
  const auto found = processes_called(name, word);
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].pid, other.pid());
  ASSERT_FALSE(found[0].files.empty()) << "its first argument is the test program";
  EXPECT_TRUE(std::filesystem::equivalent(found[0].files[0], "/proc/self/exe"));
  EXPECT_TRUE(processes_called("fxagent", word).empty()) << "another program";
  EXPECT_TRUE(processes_called(name, "run").empty()) << "an argument that it has not";
}

TEST_F(PortAccess, WhoHasLockedItIsFoundByTheLock) {
  const OtherProgram other(port, OtherProgram::Holds::locked);
  EXPECT_EQ(port_holder(port).value().pid, other.pid());
}

TEST_F(PortAccess, WhoCannotBeSeenCanBeLookedFor) {
  EXPECT_EQ(port_cure(port, EBUSY),
            " (another program uses it, such as GX Works or another agent: as root, fuser -v " +
                port + " names it; end it, or use another port)");
}

TEST_F(PortAccess, NoPermissionNamesTheGroupToJoin) {
  // A Debian group that is never the group of a test run.
  const struct group* lp = ::getgrnam("lp");
  if (lp == nullptr || ::chown(port.c_str(), static_cast<uid_t>(-1), lp->gr_gid) != 0)
    GTEST_SKIP() << "only root can give a file to the group lp: run it as root";
  ASSERT_EQ(::chmod(port.c_str(), 0660), 0);
  const std::string cure = port_cure(port, EACCES);
  EXPECT_TRUE(cure.starts_with(" (it belongs to the group lp: usermod -aG lp ")) << cure;
  test::expect_says(cure, "SupplementaryGroups=lp");
  test::expect_says(cure, "--group-add " + std::to_string(lp->gr_gid) + ")");
  ASSERT_EQ(::chmod(port.c_str(), 0600), 0);
  test::expect_says(port_cure(port, EACCES), "udev rule");
}

TEST_F(PortAccess, AllElseHasItsOwnCureOrNone) {
  test::expect_says(port_cure("/dev/none", ENOENT), "plugged in");
  test::expect_says(port_cure(port, EPERM), "DeviceAllow");
  EXPECT_EQ(port_cure(port, EIO), "");
}

}  // namespace
}  // namespace fxagent
