#include "agent/log/log_writer.h"

#include <gtest/gtest.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <thread>

namespace fxagent::log {
namespace {

using namespace std::chrono_literals;

/// A pipe that is read on demand.
struct Pipe {
  int ends[2] = {-1, -1};
  Pipe() { EXPECT_EQ(::pipe(ends), 0); }
  ~Pipe() {
    ::close(ends[0]);
    // The other end stays open: the writer's thread may still use it.
  }
  /// Reads until `last` has arrived.
  std::string read_until(const std::string& last) const {
    std::string all;
    char piece[4096];
    while (all.find(last) == std::string::npos) {
      const ssize_t count = ::read(ends[0], piece, sizeof piece);
      if (count <= 0) break;
      all.append(piece, static_cast<std::size_t>(count));
    }
    return all;
  }
};

LogWriter::Callbacks told() {
  return {[](std::uint64_t count) { return "dropped " + std::to_string(count) + "\n"; },
          [] { return std::vector<std::string>{}; }};
}

TEST(LogWriter, LinesComeInTheirOrder) {
  const Pipe pipe;
  LogWriter writer(pipe.ends[1], told());
  std::string expected;
  for (int i = 0; i < 100; ++i) {
    const std::string line = "line " + std::to_string(i) + "\n";
    expected += line;
    writer.write(line);
  }
  EXPECT_TRUE(writer.flush(10s));
  EXPECT_EQ(pipe.read_until("line 99\n"), expected);
}

// The pipe holds 64 KiB and the queue 256 KiB; the pipe is not read.
TEST(LogWriter, PipeThatNobodyReadsHoldsUpNobodyAndWhatWasDroppedIsTold) {
  const Pipe pipe;
  LogWriter writer(pipe.ends[1], told());
  const std::string line(1023, 'x');
  const auto begin = std::chrono::steady_clock::now();
  for (int i = 0; i < 1000; ++i) writer.write(line + "\n");
  EXPECT_LT(std::chrono::steady_clock::now() - begin, 5s);
  EXPECT_FALSE(writer.flush(1ms));
  const std::string all = pipe.read_until("dropped ");
  const auto lines = static_cast<std::size_t>(std::count(
      all.begin(), all.begin() + static_cast<std::ptrdiff_t>(all.find("dropped ")), '\n'));
  EXPECT_GE(lines, LogWriter::kMostBytes / 1024);
  EXPECT_LE(lines, LogWriter::kMostBytes / 1024 + 70);
  EXPECT_TRUE(writer.flush(10s));
  std::string end = all.substr(all.find("dropped "));
  if (end.find('\n') == std::string::npos) end += pipe.read_until("\n");
  EXPECT_EQ(end.substr(0, end.find('\n')), "dropped " + std::to_string(1000 - lines));
}

TEST(LogWriter, LinesThatAreMadeLaterComeInTheirOrderAndFromItsThread) {
  const Pipe pipe;
  LogWriter writer(pipe.ends[1], told());
  const auto here = std::this_thread::get_id();
  std::atomic<bool> elsewhere = true;
  std::string expected;
  for (int i = 0; i < 50; ++i) {
    const std::string number = std::to_string(i);
    writer.write("line " + number + "\n");
    writer.write_later(10, [&elsewhere, here, number] {
      if (std::this_thread::get_id() == here) elsewhere = false;
      return "made " + number + "\n";
    });
    expected += "line " + number + "\nmade " + number + "\n";
  }
  EXPECT_TRUE(writer.flush(10s));
  EXPECT_TRUE(elsewhere);
  EXPECT_EQ(pipe.read_until("made 49\n"), expected);
}

// The pipe is not read; it holds 64 KiB.
TEST(LogWriter, LinesThatAreMadeLaterLeaveHalfOfTheRoomAndAreNotWaitedFor) {
  const Pipe pipe;
  LogWriter writer(pipe.ends[1], told());
  const std::string text = std::string(1023, 'm') + "\n";
  const auto begin = std::chrono::steady_clock::now();
  for (int i = 0; i < 1000; ++i) writer.write_later(1024, [text] { return text; });
  EXPECT_LT(std::chrono::steady_clock::now() - begin, 5s);
  const std::size_t room = LogWriter::kMostBytes / 2 / 1024;
  for (std::size_t i = 0; i < room; ++i) writer.write(std::string(1023, 'x') + "\n");
  const std::string all = pipe.read_until("dropped ");
  const auto count = [&all](const std::string& line) {
    std::size_t lines = 0;
    for (auto at = all.find(line); at != all.npos; at = all.find(line, at + 1)) ++lines;
    return lines;
  };
  EXPECT_EQ(count("x\n"), room) << "no other line was dropped for them";
  EXPECT_GE(count("m\n"), room);
  EXPECT_LE(count("m\n"), room + 70);
}

TEST(LogWriter, EndsWhileItsThreadStandsInAWrite) {
  const Pipe pipe;
  const auto waiting = [&pipe] {
    int bytes = 0;
    EXPECT_EQ(::ioctl(pipe.ends[0], FIONREAD, &bytes), 0);
    return bytes;
  };
  constexpr int kFull = 65536;
  {
    LogWriter writer(pipe.ends[1], told());
    for (int i = 0; i < 200; ++i) writer.write(std::string(1024, 'x'));
    const auto deadline = std::chrono::steady_clock::now() + 20s;
    while (waiting() < kFull && std::chrono::steady_clock::now() < deadline)
      std::this_thread::yield();
  }
  EXPECT_EQ(waiting(), kFull) << "the pipe is full, so the thread stood in its write";
}

TEST(LogWriter, DueLinesAreWrittenWithoutAnybodyLogging) {
  const Pipe pipe;
  LogWriter writer(pipe.ends[1], {[](std::uint64_t) { return std::string(); },
                                  [] { return std::vector<std::string>{"due\n"}; }});
  EXPECT_NE(pipe.read_until("due\n").find("due\n"), std::string::npos);
}

constexpr LogRepeats::Time kStart{1h};

TEST(LogRepeats, FirstFewOfEqualLinesAreWrittenAndTheRestIsCounted) {
  LogRepeats repeats;
  int written = 0;
  for (int i = 0; i < 100; ++i) written += repeats.take(kStart + i * 1ms, 3, "link down") ? 1 : 0;
  EXPECT_EQ(written, 5);
  EXPECT_TRUE(repeats.take(kStart, 3, "another"));
  EXPECT_TRUE(repeats.over(kStart + 9s).empty());
  const auto told = repeats.over(kStart + 10s);
  ASSERT_EQ(told.size(), 1U);
  EXPECT_EQ(told[0].text, "link down");
  EXPECT_EQ(told[0].level, 3);
  EXPECT_EQ(told[0].count, 95U);
  EXPECT_TRUE(repeats.over(kStart + 20s).empty());
  EXPECT_TRUE(repeats.take(kStart + 21s, 3, "link down"));
}

TEST(LogRepeats, LinesThatComeNowAndThenAreAllWritten) {
  LogRepeats repeats;
  for (int i = 0; i < 100; ++i) EXPECT_TRUE(repeats.take(kStart + i * 3s, 2, "x"));
  EXPECT_TRUE(repeats.over(LogRepeats::Time::max()).empty());
}

TEST(LogRepeats, FloodOfDifferentTextsTakesNoMemory) {
  LogRepeats repeats;
  for (int i = 0; i < 10000; ++i) EXPECT_TRUE(repeats.take(kStart, 2, std::to_string(i)));
  // The table is full; later it has room again.
  for (int i = 0; i < 10; ++i) EXPECT_TRUE(repeats.take(kStart, 2, "beyond"));
  int written = 0;
  for (int i = 0; i < 10; ++i) written += repeats.take(kStart + 11s, 2, "beyond") ? 1 : 0;
  EXPECT_EQ(written, 5);
}

}  // namespace
}  // namespace fxagent::log
