#include "agent/log/log_writer.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include "tests/support/notify_inbox.h"

namespace fxagent::log {
namespace {

TEST(JournalStream, IsTheFileWhoseDeviceAndInodeAreNamed) {
  int ends[2] = {-1, -1};
  ASSERT_EQ(::pipe(ends), 0);
  struct stat file {};
  ASSERT_EQ(::fstat(ends[1], &file), 0);
  const std::string device = std::to_string(file.st_dev);
  const std::string inode = std::to_string(file.st_ino);
  EXPECT_FALSE(is_journal_stream(ends[1])) << "nothing is named";
  {
    const test::Variable named("JOURNAL_STREAM", device + ":" + inode);
    EXPECT_TRUE(is_journal_stream(ends[1]));
    const int redirected = ::open("/dev/null", O_WRONLY);
    EXPECT_FALSE(is_journal_stream(redirected)) << "the variable was inherited";
    ::close(redirected);
    EXPECT_FALSE(is_journal_stream(-1));
  }
  for (const std::string& wrong :
       {std::string(), inode, device + ":", device + ":" + inode + "0"}) {
    const test::Variable named("JOURNAL_STREAM", wrong);
    EXPECT_FALSE(is_journal_stream(ends[1])) << wrong;
  }
  ::close(ends[0]);
  ::close(ends[1]);
}

}  // namespace
}  // namespace fxagent::log
