// Files that SQLite opens without an error and that are not valid stores: truncated, or without a
// table.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "agent/store/disk/sqlite.h"
#include "agent/store/store.h"
#include "tests/agent/store/shelf.h"

namespace fxagent {
namespace {

using namespace test;
namespace fs = std::filesystem;

struct StoreDamage : testing::Test {
  static std::vector<SampleRow> rows(std::uint64_t count) {
    std::vector<SampleRow> made(count);
    for (std::uint64_t i = 0; i < count; ++i) {
      made[i].stream = {"press1", "fast"};
      made[i].seq = i + 1;
      made[i].content = row_content(i + 1, std::string(300, 'x'));
    }
    return made;
  }
  void make() {
    Store store(shelf_.config, kNow);
    auto some = rows(50);
    ASSERT_TRUE(store.samples().append(some, Store::Hold::no));
    store.close();
  }
  void change(const std::string& sql) const {
    SQLite::Database database = sqlite::open(shelf_.file());
    ASSERT_NO_THROW(database.exec(sql));
  }
  /// Expects the store to work on a fresh file, next to the damaged one.
  void expect_a_fresh_one() {
    Store store(shelf_.config, kNow);
    EXPECT_TRUE(store.is_writable());
    EXPECT_EQ(store.samples().rows(), 0U);
    auto one = rows(1);
    EXPECT_TRUE(store.samples().append(one, Store::Hold::no));
    EXPECT_TRUE(fs::exists(shelf_.file() + ".corrupt-" + std::to_string(kNow)));
    store.close();
  }

  Shelf shelf_;
};

TEST_F(StoreDamage, FileCutShortAnywhereIsSetAside) {
  make();
  const auto whole = fs::file_size(shelf_.file());
  fs::copy_file(shelf_.file(), shelf_.scratch.path("whole"));
  for (std::uintmax_t size = 4096; size < whole; size += 4096 + 512) {
    SCOPED_TRACE(size);
    fs::remove_all(shelf_.config.path);
    fs::create_directory(shelf_.config.path);
    fs::copy_file(shelf_.scratch.path("whole"), shelf_.file());
    fs::resize_file(shelf_.file(), size);
    expect_a_fresh_one();
  }
}

TEST_F(StoreDamage, FileWithoutOneOfTheTablesIsSetAside) {
  for (const std::string table : {"samples", "devices", "orders"}) {
    SCOPED_TRACE(table);
    fs::remove_all(shelf_.config.path);
    make();
    change("DROP TABLE " + table);
    expect_a_fresh_one();
  }
}

TEST_F(StoreDamage, TableWithAnotherColumnIsSetAsideAndAnIndexMoreIsNot) {
  make();
  change("CREATE INDEX by_time ON samples(created_ms); ANALYZE");
  {
    Store store(shelf_.config, kNow);
    EXPECT_EQ(store.samples().rows(), 50U);
    store.close();
  }
  change("ALTER TABLE orders RENAME COLUMN correlation TO colleration");
  expect_a_fresh_one();
}

TEST_F(StoreDamage, DamagedRowIsDroppedAndCountedAndItsNeighboursGoOut) {
  make();
  change(
      "UPDATE samples SET row = substr(row, 1, 100) WHERE id IN (1, 7);"
      "UPDATE samples SET row = x'22FF22' WHERE id = 50");
  Store store(shelf_.config, kNow);
  EXPECT_EQ(store.samples().rows(), 50U);
  std::uint64_t delivered = 0;
  while (const auto batch = test::next(store.samples(), 4096, any)) {
    EXPECT_TRUE(nlohmann::json::accept(batch->payload));
    delivered += store.samples().remove(*batch);
  }
  EXPECT_EQ(delivered, 47U);
  EXPECT_EQ(store.samples().rows(), 0U);
  EXPECT_EQ(store.bytes(), 0U);
  EXPECT_EQ(store.samples().take_dropped(), (std::map<std::string, std::uint64_t>{{"press1", 3}}));
  EXPECT_FALSE(store.samples().streams().has_waiting("press1"));
}

TEST_F(StoreDamage, StreamOfDamagedRowsAloneIsDroppedAndCounted) {
  {
    Store store(shelf_.config, kNow);
    auto both = rows(4);
    both[3].stream.device = "press2";
    ASSERT_TRUE(store.samples().append(both, Store::Hold::no));
    store.close();
  }
  change("UPDATE samples SET row = '{' WHERE device = 'press1'");
  Store store(shelf_.config, kNow);
  const auto batch = test::next(store.samples(), 4096, any);
  ASSERT_TRUE(batch);
  EXPECT_EQ(batch->stream.device, "press2");
  EXPECT_EQ(store.samples().take_dropped(), (std::map<std::string, std::uint64_t>{{"press1", 3}}));
  EXPECT_EQ(store.samples().remove(*batch), 1U);
  EXPECT_EQ(store.samples().rows(), 0U);
  EXPECT_EQ(store.bytes(), 0U);
}

TEST_F(StoreDamage, SamplesBeforeTheDamageAreCountedAsFoundAndAsDropped) {
  make();
  std::int64_t page = 0;
  {
    SQLite::Database database = sqlite::open(shelf_.file());
    page =
        database.execAndGet("SELECT rootpage FROM sqlite_master WHERE name = 'orders'").getInt64();
  }
  {
    std::fstream file(shelf_.file(), std::ios::in | std::ios::out | std::ios::binary);
    file.seekp(4096 * (page - 1));
    file << std::string(4096, '\xA5');
  }
  Store store(shelf_.config, kNow);
  EXPECT_EQ(store.samples().rows(), 0U);
  EXPECT_EQ(store.samples().recovered(), 50U);
  EXPECT_EQ(store.samples().take_dropped()["press1"], 50U);
}

TEST_F(StoreDamage, FileOfAnotherProgramIsSetAside) {
  fs::create_directory(shelf_.config.path);
  change("CREATE TABLE samples(other); PRAGMA user_version = 0");
  expect_a_fresh_one();
}

}  // namespace
}  // namespace fxagent
