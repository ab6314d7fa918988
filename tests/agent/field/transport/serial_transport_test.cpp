#include "agent/field/transport/transport.h"

#include <asm/termbits.h>  // termios2, for any speed; conflicts with <termios.h>
#include <fcntl.h>
#include <gtest/gtest.h>
#include <stdlib.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <array>
#include <asio/post.hpp>
#include <filesystem>

#include "tests/agent/field/transport/blocking_transport.h"
#include "tests/support/says.h"

namespace fxagent::test {
namespace {

using std::chrono::milliseconds;

/// A pty: the test holds the PLC's end, the agent opens the path.
class Pty final {
 public:
  Pty() {
    plc_ = posix_openpt(O_RDWR | O_NOCTTY);
    std::array<char, 128> name{};
    EXPECT_EQ(grantpt(plc_), 0);
    EXPECT_EQ(unlockpt(plc_), 0);
    EXPECT_EQ(ptsname_r(plc_, name.data(), name.size()), 0);
    path_ = name.data();
    kept_ = ::open(path_.c_str(), O_RDWR | O_NOCTTY);
    EXPECT_GE(kept_, 0);
  }
  Pty(const Pty&) = delete;
  Pty& operator=(const Pty&) = delete;
  ~Pty() { unplug(); }

  const std::string& path() const { return path_; }
  int plc() const { return plc_; }
  void say(const std::string& bytes) const {
    EXPECT_EQ(::write(plc_, bytes.data(), bytes.size()), static_cast<ssize_t>(bytes.size()));
  }
  std::string hear(std::size_t size) const {
    std::string bytes(size, '\0');
    const auto count = ::read(plc_, bytes.data(), size);
    bytes.resize(count > 0 ? static_cast<std::size_t>(count) : 0);
    return bytes;
  }
  /// Closes both ends that the test holds, so that the agent's end hangs up.
  void unplug() {
    for (int* fd : {&plc_, &kept_})
      if (*fd >= 0) ::close(std::exchange(*fd, -1));
  }

 private:
  int plc_ = -1;
  int kept_ = -1;
  std::string path_;
};

struct SerialTransportTest : TransportTest {
  std::unique_ptr<Transport> port(const std::string& path) {
    return make_serial_transport(io.get_executor(), {.path = path});
  }
  std::unique_ptr<Transport> opened(const Pty& pty) {
    auto made = port(pty.path());
    open_well(*made);
    return made;
  }
};

struct SerialTransportOpened : SerialTransportTest {
  const Pty pty;
  const std::unique_ptr<Transport> transport = opened(pty);
};

TEST_F(SerialTransportOpened, BytesGoBothWaysUnchanged) {
  EXPECT_TRUE(transport->is_open());
  // Bytes that a terminal would swallow or change: ETX, CR, LF, XON, XOFF, EOT, and all 7 bits set.
  const std::string all = "\x02\x03\x04\x05\x06\x11\x13\x15\r\n\x1a\x7f";
  const auto written = write(*transport, all);
  EXPECT_EQ(written.sent, all.size());
  EXPECT_FALSE(written.error);
  EXPECT_EQ(pty.hear(64), all);
  pty.say(all);
  EXPECT_EQ(read(*transport), all);
}

TEST_F(SerialTransportTest, MissingPathIsLinkDownAndNamesTheCure) {
  const auto transport = port("/dev/ttyNone0");
  const auto error = error_of(open(*transport));
  EXPECT_EQ(error.code, ErrorCode::link_down);
  expect_says(error.text, "/dev/ttyNone0");
  expect_says(error.text, "plugged in");
  EXPECT_FALSE(transport->is_open());
}

TEST_F(SerialTransportTest, PathThatIsNoPortIsLinkDown) {
  const std::string text = error_of(open(*port("/dev/null"))).text;
  expect_says(text, "/dev/null is not a serial port: ");
  expect_says(text, "correct path");
}

TEST_F(SerialTransportTest, PortThatCannotSwitchTheDirectionIsLinkDownAndNamed) {
  const Pty pty;
  const auto transport =
      make_serial_transport(io.get_executor(), {.path = pty.path(), .rs485 = Rs485{}});
  const auto error = error_of(open(*transport));
  EXPECT_EQ(error.code, ErrorCode::link_down);
  EXPECT_TRUE(error.text.starts_with(pty.path() + " cannot switch")) << error.text;
  EXPECT_FALSE(transport->is_open());
  EXPECT_TRUE(open(*port(pty.path()))) << "free again";
}

TEST_F(SerialTransportTest, PortThatIsLockedIsLeftAlone) {
  const Pty pty;
  const int other = ::open(pty.path().c_str(), O_RDWR | O_NOCTTY);
  ASSERT_GE(other, 0);
  ASSERT_EQ(flock(other, LOCK_EX | LOCK_NB), 0);
  const auto transport = port(pty.path());
  const auto error = error_of(open(*transport));
  EXPECT_EQ(error.code, ErrorCode::link_down);
  expect_says(error.text, "is locked");
  ::close(other);
  EXPECT_TRUE(open(*transport)) << "free again";
}

TEST_F(SerialTransportTest, TwoOfOurOwnExcludeEachOther) {
  const Pty pty;
  const auto first = port(pty.path());
  const auto second = port(pty.path());
  ASSERT_TRUE(open(*first));
  EXPECT_FALSE(open(*second));
  first->close();
  EXPECT_TRUE(open(*second));
}

TEST_F(SerialTransportOpened, ReadEndsAtItsDeadline) {
  EXPECT_EQ(read(*transport, milliseconds(10)), "timeout");
  EXPECT_EQ(read(*transport, milliseconds(0)), "timeout");
  EXPECT_TRUE(transport->is_open());
  pty.say("late");
  EXPECT_EQ(read(*transport), "late") << "a timeout leaves the port usable";
  EXPECT_EQ(read(*transport, milliseconds(10)), "timeout") << "and the next deadline holds too";
}

TEST_F(SerialTransportTest, VanishedPortIsLinkDownAndOpensAgainByItsPath) {
  const auto link =
      std::filesystem::temp_directory_path() / ("fxagent-port-" + std::to_string(::getpid()));
  const auto transport = port(link.string());
  {
    Pty first;
    std::filesystem::remove(link);
    std::filesystem::create_symlink(first.path(), link);
    ASSERT_TRUE(open(*transport));
    first.unplug();
    EXPECT_EQ(read(*transport), "link_down");
    EXPECT_FALSE(transport->discard_input());
    EXPECT_FALSE(transport->is_open());
  }
  const Pty second;
  std::filesystem::remove(link);
  EXPECT_FALSE(open(*transport)) << "not plugged in yet";
  std::filesystem::create_symlink(second.path(), link);
  ASSERT_TRUE(open(*transport));
  second.say("here");
  EXPECT_EQ(read(*transport), "here");
  std::filesystem::remove(link);
}

TEST_F(SerialTransportTest, VanishedPortTakesNoBytes) {
  Pty pty;
  const auto transport = opened(pty);
  pty.unplug();
  const auto written = write(*transport, "hello");
  EXPECT_EQ(written.sent, 0U);
  ASSERT_TRUE(written.error);
  EXPECT_EQ(written.error->code, ErrorCode::link_down);
}

TEST_F(SerialTransportTest, LineThatTakesNoMoreBytesEndsTheWrite) {
  const Pty pty;  // its other end is never read
  const auto transport = opened(pty);
  const std::string flood(1 << 20, 0x55);
  const auto written = write(*transport, flood, milliseconds(20));
  ASSERT_TRUE(written.error);
  EXPECT_GT(written.sent, 0U);
  EXPECT_LT(written.sent, flood.size());
}

TEST_F(SerialTransportOpened, DiscardThrowsAwayWhatHasArrived) {
  EXPECT_EQ(transport->discard_input().value_or(Bytes(99)).size(), 0U);
  pty.say("stale reply");
  std::size_t thrown_away = 0;
  run_until(io, [&] {  // the kernel delivers it at some later time
    thrown_away += transport->discard_input().value_or(Bytes{}).size();
    return thrown_away == 11;
  });
  pty.say("new");
  EXPECT_EQ(read(*transport), "new");
}

TEST_F(SerialTransportOpened, ClosingEndsAWaitingRead) {
  asio::post(io, [&] { asio::post(io, [&] { transport->close(); }); });
  EXPECT_EQ(read(*transport, std::chrono::hours(1)), "link_down");
  EXPECT_FALSE(transport->is_open());
}

TEST_F(SerialTransportOpened, NothingKeepsTheThreadAfterClosing) {
  pty.say("x");
  EXPECT_EQ(read(*transport, std::chrono::hours(1)), "x");
  transport->close();
  io.restart();
  io.run_for(std::chrono::seconds(10));
  EXPECT_TRUE(io.stopped()) << "the deadline of a read that is over still waits";
}

TEST_F(SerialTransportOpened, PortIsRawAtTheSpeedAskedFor) {
  termios2 settings{};
  ASSERT_EQ(ioctl(pty.plc(), TCGETS2, &settings), 0);
  EXPECT_EQ(settings.c_ospeed, 9600U);
  EXPECT_EQ(settings.c_ispeed, 9600U);
  EXPECT_EQ(settings.c_lflag & static_cast<tcflag_t>(ICANON | ECHO | ISIG), 0U);
  EXPECT_EQ(settings.c_iflag & static_cast<tcflag_t>(IXON | ICRNL | ISTRIP), 0U);
  EXPECT_EQ(settings.c_oflag & static_cast<tcflag_t>(OPOST), 0U);
}

}  // namespace
}  // namespace fxagent::test
