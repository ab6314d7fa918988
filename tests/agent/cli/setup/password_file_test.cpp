// A password file for the service's user.
#include "agent/cli/setup/init_machine.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <csignal>
#include <fstream>
#include <iterator>

#include "tests/support/scratch.h"

namespace fxagent {
namespace {

struct PasswordFiles : testing::Test {
  std::string text() const { return test::content_of(path); }

 private:
  const test::Scratch scratch_;

 protected:
  const std::string path = scratch_.path("mqtt_password");
};

TEST_F(PasswordFiles, BelongsToTheServiceAndToNobodyElse) {
  const auto made = create_password_file(path, "se cret", "daemon");
  ASSERT_TRUE(made) << made.error();
  EXPECT_TRUE(made->is_new);
  EXPECT_EQ(text(), "se cret\n");
  struct stat file {};
  ASSERT_EQ(::stat(path.c_str(), &file), 0);
  EXPECT_EQ(file.st_mode & 0777U, 0600U);
  if (::geteuid() != 0) GTEST_SKIP() << "only root can give a file away: run it as root";
  EXPECT_EQ(made->owner, "daemon");
  EXPECT_EQ(file.st_uid, 1U) << "Debian's daemon";
}

TEST_F(PasswordFiles, WithoutThatUserItIsOnesOwn) {
  const auto made = create_password_file(path, "", "no-such-user");
  ASSERT_TRUE(made) << made.error();
  EXPECT_EQ(text(), "");
  struct stat file {};
  ASSERT_EQ(::stat(path.c_str(), &file), 0);
  EXPECT_EQ(file.st_uid, ::geteuid());
  if (::geteuid() == 0) {
    EXPECT_EQ(made->owner, "root");
  }
}

TEST_F(PasswordFiles, OneThatIsThereStaysAsItIs) {
  std::ofstream(path) << "mine";
  const auto made = create_password_file(path, "other", "daemon");
  ASSERT_TRUE(made) << made.error();
  EXPECT_FALSE(made->is_new);
  EXPECT_EQ(text(), "mine");
}

TEST_F(PasswordFiles, ADiskThatRefusesLeavesNone) {
  rlimit before{};
  ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &before), 0);
  const auto heard = std::signal(SIGXFSZ, SIG_IGN);
  rlimit full = before;
  full.rlim_cur = 4;
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &full), 0);
  const auto made = create_password_file(path, "se cret", "no-such-user");
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &before), 0);
  std::signal(SIGXFSZ, heard);
  ASSERT_FALSE(made);
  EXPECT_EQ(made.error(), path + " cannot be created: File too large");
  EXPECT_NE(::access(path.c_str(), F_OK), 0);
}

TEST_F(PasswordFiles, WhyItCannotBeCreatedIsSaid) {
  const auto made = create_password_file(path + "/x", "", "daemon");
  ASSERT_FALSE(made);
  EXPECT_EQ(made.error(), path + "/x cannot be created: No such file or directory");
}

}  // namespace
}  // namespace fxagent
