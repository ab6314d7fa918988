#include "agent/store/disk/durable_file.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "tests/agent/store/synced_files.h"
#include "tests/support/disk_limit.h"
#include "tests/support/scratch.h"

namespace fxagent {
namespace {

using test::Scratch;

constexpr std::size_t kMost = 1 << 20;

std::optional<std::string> content(const DurableFile& file) {
  const auto text = file.read(kMost);
  EXPECT_TRUE(text.has_value()) << (text ? "" : text.error());
  return text.value_or(std::nullopt);
}

struct DurableFileTest : ::testing::Test {
  const Scratch scratch;
  DurableFile file{scratch.path("store"), "kept.json"};
};

TEST_F(DurableFileTest, WhatWasWrittenIsReadByTheNext) {
  EXPECT_EQ(content(file), std::nullopt);
  EXPECT_EQ(file.write("one"), "");
  EXPECT_EQ(file.write("two"), "");
  EXPECT_EQ(content(DurableFile(scratch.path("store"), "kept.json")), "two");
  EXPECT_EQ(file.remove(), "");
  EXPECT_EQ(content(file), std::nullopt);
  EXPECT_EQ(file.remove(), "");
}

TEST_F(DurableFileTest, APowerCutLeavesWhatWasWrittenLast) {
  const test::SyncedFiles disk;
  int cuts = 0;
  const auto after_a_power_cut = [&] {
    const std::string directory = scratch.path("after-" + std::to_string(++cuts));
    disk.leave(scratch.path("store"), directory);
    return content(DurableFile(directory, "kept.json"));
  };
  ASSERT_EQ(file.write("one"), "");
  EXPECT_EQ(after_a_power_cut(), "one");
  ASSERT_EQ(file.write("two"), "");
  EXPECT_EQ(after_a_power_cut(), "two");
  ASSERT_EQ(file.remove(), "");
  EXPECT_EQ(after_a_power_cut(), std::nullopt);
}

TEST_F(DurableFileTest, DiskOfTheTestLosesWhatWasNotSynchronised) {
  const test::SyncedFiles disk;
  ASSERT_EQ(file.write("one"), "");
  std::filesystem::rename(file.path(), scratch.path("store") + "/other.json");
  std::ofstream(file.path()) << "two";
  disk.leave(scratch.path("store"), scratch.path("after"));
  EXPECT_EQ(content(DurableFile(scratch.path("after"), "kept.json")), "one");
  EXPECT_EQ(content(DurableFile(scratch.path("after"), "other.json")), std::nullopt);
}

TEST_F(DurableFileTest, NobodyElseReadsIt) {
  ASSERT_EQ(file.write("one"), "");
  struct stat found {};
  ASSERT_EQ(::stat(file.path().c_str(), &found), 0);
  EXPECT_EQ(found.st_mode & 0777, 0600u);
  ASSERT_EQ(::stat(scratch.path("store").c_str(), &found), 0);
  EXPECT_EQ(found.st_mode & 0777, 0700u);
}

TEST_F(DurableFileTest, NothingIsLeftBesideIt) {
  std::filesystem::create_directory(scratch.path("store"));
  std::ofstream(file.path() + ".new") << "half of";  // left by a crash
  ASSERT_EQ(file.write("one"), "");
  std::size_t files = 0;
  for (const auto& each : std::filesystem::directory_iterator(scratch.path("store"))) {
    EXPECT_EQ(each.path().string(), file.path());
    ++files;
  }
  EXPECT_EQ(files, 1u);
}

TEST_F(DurableFileTest, ADiskThatRefusesLeavesTheOneBefore) {
  ASSERT_EQ(file.write("one"), "");
  std::string why;
  {
    const test::DiskLimit full(1024);
    why = file.write(std::string(4096, 'x'));
  }
  EXPECT_NE(why, "");
  EXPECT_EQ(content(file), "one");
  EXPECT_FALSE(std::filesystem::exists(file.path() + ".new"));
}

TEST_F(DurableFileTest, LinksAndWhatIsTooLargeAreNotRead) {
  ASSERT_EQ(file.write("one two three"), "");
  EXPECT_FALSE(file.read(5).has_value());
  std::filesystem::rename(file.path(), scratch.path("elsewhere"));
  std::filesystem::create_symlink(scratch.path("elsewhere"), file.path());
  EXPECT_FALSE(file.read(kMost).has_value());
  // Writing replaces the link.
  EXPECT_EQ(file.write("mine"), "");
  EXPECT_EQ(content(file), "mine");
  EXPECT_EQ(std::filesystem::file_size(scratch.path("elsewhere")), 13u);
}

TEST_F(DurableFileTest, ADirectoryThatOthersWriteIsRefused) {
  std::filesystem::create_directory(scratch.path("store"));
  std::filesystem::permissions(scratch.path("store"), std::filesystem::perms::all);
  EXPECT_NE(DurableFile(scratch.path("store"), "kept.json").write("one"), "");
}

TEST_F(DurableFileTest, OneProcessOfTwoHasTheLock) {
  std::optional<DurableFile> first(std::in_place, scratch.path("store"), "kept.json");
  DurableFile second(scratch.path("store"), "kept.json");
  EXPECT_EQ(first->lock(), "");
  EXPECT_EQ(first->lock(), "");
  EXPECT_NE(second.lock().find("in use by a running fxagent"), std::string::npos) << second.lock();
  first.reset();
  EXPECT_EQ(second.lock(), "");
}

TEST_F(DurableFileTest, ADirectoryThatWasReplacedIsLockedAgain) {
  ASSERT_EQ(file.lock(), "");
  std::filesystem::rename(scratch.path("store"), scratch.path("away"));
  EXPECT_EQ(file.lock(), "");
  EXPECT_NE(DurableFile(scratch.path("store"), "kept.json").lock(), "");
}

}  // namespace
}  // namespace fxagent
