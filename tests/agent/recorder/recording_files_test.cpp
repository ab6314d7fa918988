#include "agent/recorder/recording_files.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "tests/support/scratch.h"

namespace fxagent {
namespace {

namespace fs = std::filesystem;

struct RecordingFilesTest : testing::Test {
  const test::Scratch scratch;
  const std::string directory = scratch.path("recordings");

  std::set<std::string> recordings() const {
    std::set<std::string> names;
    for (const auto& entry : fs::directory_iterator(directory))
      if (entry.path().extension() == kRecordingSuffix) names.insert(entry.path().filename());
    return names;
  }
  static std::string write(RecordingFiles& files, std::int64_t second, const std::string& text) {
    std::string path;
    EXPECT_EQ(files.write("line1", second * 1'000'000, text, path), "");
    return path;
  }
};

TEST_F(RecordingFilesTest, AreForTheirOwnerAloneAndNamedByTimeAndLink) {
  RecordingFiles files(directory, 3, 1000);
  ASSERT_EQ(files.begin(), "");
  const std::string path = write(files, 1'795'716'000, "text");
  EXPECT_EQ(fs::path(path).filename(), "2026-11-26T18-00-00.000000Z-line1.fxrec");
  struct stat facts {};
  ASSERT_EQ(::stat(path.c_str(), &facts), 0);
  EXPECT_EQ(facts.st_mode & 0777U, 0600U);
}

TEST_F(RecordingFilesTest, TheOldestGoBeyondTheNumber) {
  RecordingFiles files(directory, 3, 1000);
  ASSERT_EQ(files.begin(), "");
  std::string newest;
  for (int i = 0; i < 10; ++i) newest = write(files, 1'795'716'000 + i, "text");
  EXPECT_EQ(recordings().size(), 3U);
  EXPECT_EQ(*recordings().rbegin(), fs::path(newest).filename());
  EXPECT_EQ(*recordings().begin(), "2026-11-26T18-00-07.000000Z-line1.fxrec");
}

TEST_F(RecordingFilesTest, TheOldestGoBeyondTheBytes) {
  RecordingFiles files(directory, 100, 1000);
  ASSERT_EQ(files.begin(), "");
  for (int i = 0; i < 10; ++i) write(files, 1'795'716'000 + i, std::string(300, 'x'));
  EXPECT_EQ(recordings().size(), 3U);
  std::string path;
  const std::string fault = files.write("line1", 1, std::string(1001, 'x'), path);
  EXPECT_NE(fault.find("max_bytes is 1000"), std::string::npos) << fault;
  EXPECT_EQ(recordings().size(), 3U) << "a recording that cannot fit deletes none";
}

TEST_F(RecordingFilesTest, FilesOfAClockThatWasAheadAreTheOldest) {
  RecordingFiles files(directory, 4, 1000);
  ASSERT_EQ(files.begin(), "");
  for (const char* name : {"/pump.fxrec", "/2027-pump.fxrec"})
    std::ofstream(directory + name) << "kept by a user";
  for (int i = 0; i < 2; ++i) write(files, 2'190'000'000 + i, "2039");
  const std::string first = write(files, 1'795'716'000, "text");
  std::string path;
  ASSERT_EQ(files.write("line2", 1'795'716'000'000'001, "text", path), "");
  EXPECT_EQ(recordings(),
            (std::set<std::string>{fs::path(first).filename(), fs::path(path).filename(),
                                   "pump.fxrec", "2027-pump.fxrec"}));
}

TEST_F(RecordingFilesTest, OtherFilesStayAndHalvesOfACrashGo) {
  RecordingFiles files(directory, 1, 1000);
  ASSERT_EQ(files.begin(), "");
  std::ofstream(directory + "/notes.txt") << "mine";
  std::ofstream(directory + "/x.fxrec.new") << "half";
  write(files, 1, "a");
  write(files, 2, "b");
  EXPECT_TRUE(fs::exists(directory + "/notes.txt"));
  EXPECT_FALSE(fs::exists(directory + "/x.fxrec.new"));
}

TEST_F(RecordingFilesTest, ARequestIsTakenOnceAndAnswered) {
  RecordingFiles files(directory, 3, 1000);
  ASSERT_EQ(files.begin(), "");
  EXPECT_TRUE(files.take_request().empty());
  ASSERT_EQ(leave_request(directory, {"line1", "line2"}), "");
  EXPECT_EQ(files.take_request(), (std::vector<std::string>{"line1", "line2"}));
  EXPECT_TRUE(files.take_request().empty());
  EXPECT_EQ(last_answer(directory), "");
  const std::string path = write(files, 1, "a");
  ASSERT_EQ(files.answer(1'795'716'000'000'000, {path, "gone.fxrec"}), "");
  EXPECT_EQ(last_answer(directory), "2026-11-26T18:00:00.000000Z\n" + path + "\n");
}

TEST_F(RecordingFilesTest, TheWriterIsFoundWhileItRunsAndKeepsOthersAway) {
  EXPECT_FALSE(writer_of(directory));
  int ready[2];
  int over[2];
  ASSERT_EQ(::pipe(ready), 0);
  ASSERT_EQ(::pipe(over), 0);
  const pid_t child = ::fork();
  if (child == 0) {
    ::close(over[1]);
    RecordingFiles files(directory, 3, 1000);
    const char well = files.begin().empty() ? 'y' : 'n';
    char end = 0;
    const bool told = ::write(ready[1], &well, 1) == 1 && ::read(over[0], &end, 1) == 0;
    ::_exit(told ? 0 : 1);
  }
  ::close(over[0]);
  char well = 0;
  ASSERT_EQ(::read(ready[0], &well, 1), 1);
  EXPECT_EQ(well, 'y');
  EXPECT_EQ(writer_of(directory), child);
  RecordingFiles second(directory, 3, 1000);
  EXPECT_NE(second.begin().find("in use by a running fxagent"), std::string::npos);
  std::string path;
  EXPECT_NE(second.write("line1", 1, "a", path), "") << "it does not delete the first's files";
  ::close(over[1]);
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  EXPECT_EQ(status, 0);
  EXPECT_FALSE(writer_of(directory));
  EXPECT_EQ(second.write("line1", 1, "a", path), "") << "it takes over";
  ::close(ready[0]);
  ::close(ready[1]);
}

}  // namespace
}  // namespace fxagent
