#include "agent/store/store.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include <algorithm>
#include <csignal>
#include <filesystem>
#include <fstream>

#include "agent/commands/audit_records.h"
#include "agent/store/sqlite.h"
#include "tests/agent/store/scratch.h"

namespace fxagent {
namespace {

using namespace std::chrono_literals;

constexpr std::int64_t kNow = 1790000000000;
const SteadyTime kStart{std::chrono::hours(1)};

std::vector<SampleRow> rows(std::uint64_t from, std::uint64_t to, const std::string& device = "a",
                            const std::string& group = "fast") {
  std::vector<SampleRow> made;
  for (std::uint64_t seq = from; seq <= to; ++seq)
    made.push_back({0, device, group, seq, std::to_string(seq)});
  return made;
}

bool any(const StreamKey&) { return true; }

JournalEntry entry(std::string id, std::string result = {}, std::int64_t received_ms = kNow) {
  JournalEntry made;
  made.device = "a";
  made.id = std::move(id);
  made.received_ms = received_ms;
  made.deadline_ms = received_ms + 10000;
  made.op = "write";
  made.response_topic = "hmi/replies";
  made.correlation = {1, 0, 255};
  made.result = std::move(result);
  return made;
}

/// A store in a directory of its own, opened as often as wanted.
struct Shelf {
  test::Scratch scratch;
  StoreConfig config;
  std::unique_ptr<Store> store;

  Shelf() { config.path = scratch.path("store"); }
  Store& open(std::int64_t utc_ms = kNow) {
    store.reset();
    store = std::make_unique<Store>(config, utc_ms);
    return *store;
  }
  /// A file in its place: nothing can be opened there.
  void block() const { std::ofstream(config.path) << "a file in its place"; }
  std::string file() const { return config.path + "/fxagent.db"; }
  /// The number before the first one of device a in this boot.
  std::uint64_t begin(std::int64_t utc_ms = kNow) {
    const std::string device = "a";
    return store->begin_numbers(std::span(&device, 1), utc_ms).at(0);
  }
  bool add(std::vector<SampleRow> made, Store::Hold hold = Store::Hold::no) {
    return store->append(made, hold);
  }
  /// As the command that has just come.
  JournalEntry arrived(std::string id, std::string result = {}, std::int64_t received_ms = kNow) {
    JournalEntry made = entry(std::move(id), std::move(result), received_ms);
    made.number = store->next_command_number();
    return made;
  }
  /// Everything that waits, message by message, each acknowledged.
  std::string drain(std::size_t max_payload = 65536) {
    std::string all;
    while (const auto batch = store->next(max_payload, any)) {
      all += batch->device + "/" + batch->group + batch->payload.substr(23);
      EXPECT_EQ(store->remove(*batch), batch->row_ids.size());
    }
    return all;
  }
};

TEST(Store, RowsOutliveTheProcessAndGoOldestFirst) {
  Shelf shelf;
  shelf.open();
  ASSERT_EQ(shelf.store->state(), "disk");
  ASSERT_TRUE(shelf.add(rows(3, 4, "b")));
  ASSERT_TRUE(shelf.add(rows(1, 3)));
  const std::uint64_t bytes = shelf.store->bytes();
  shelf.open();
  EXPECT_EQ(shelf.store->recovered(), 5U);
  EXPECT_EQ(shelf.store->bytes(), bytes);
  EXPECT_EQ(shelf.drain(), "b/fast[3,4]}a/fast[1,2,3]}");
  EXPECT_EQ(shelf.store->rows(), 0U);
  EXPECT_EQ(shelf.store->bytes(), 0U);
  shelf.store->close();
  EXPECT_EQ(shelf.open().recovered(), 0U);
}

TEST(Store, NumbersDecideTheOrderOfALane) {
  Shelf shelf;
  shelf.open();
  shelf.add(rows(3, 4));
  shelf.add(rows(1, 2));
  EXPECT_EQ(shelf.drain(27), "a/fast[1]}a/fast[2]}a/fast[3]}a/fast[4]}");
}

TEST(Store, FilesAreTheOwnersAlone) {
  Shelf shelf;
  shelf.open();
  struct stat facts {};
  std::size_t files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(shelf.config.path)) {
    ASSERT_EQ(::stat(entry.path().c_str(), &facts), 0);
    EXPECT_EQ(facts.st_mode & 0777, 0600U) << entry.path();
    ++files;
  }
  EXPECT_EQ(files, 4U);  // the database, its log and the log's index; the lock
  ASSERT_EQ(::stat(shelf.config.path.c_str(), &facts), 0);
  EXPECT_EQ(facts.st_mode & 0777, 0700U);
}

TEST(Store, UnacknowledgedRowsAreStillThereAfterACrash) {
  Shelf shelf;
  shelf.open();
  shelf.add(rows(1, 3));
  const auto batch = shelf.store->next(65536, any);
  ASSERT_TRUE(batch);
  EXPECT_FALSE(shelf.store->next(65536, any));  // one batch of a stream at a time
  EXPECT_EQ(shelf.store->rows(), 3U);
  shelf.open();
  EXPECT_EQ(shelf.drain(), "a/fast[1,2,3]}");
}

TEST(Store, ReturnedRowsGoAgainInTheirPlaces) {
  Shelf shelf;
  shelf.open();
  shelf.add(rows(1, 3));
  const auto batch = shelf.store->next(28, any);
  ASSERT_TRUE(batch);
  shelf.add(rows(4, 4));
  shelf.store->returned(*batch);
  EXPECT_EQ(shelf.drain(), "a/fast[1,2,3,4]}");
}

TEST(Store, HeldRowsAreNoHistoryUntilTheyAreReleased) {
  Shelf shelf;
  shelf.open();
  auto held = rows(1, 3);
  ASSERT_TRUE(shelf.store->append(held, Store::Hold::yes));
  EXPECT_FALSE(shelf.store->has_waiting("a"));
  EXPECT_FALSE(shelf.store->next(65536, any));
  const std::uint64_t first[] = {held[0].row_id};
  EXPECT_EQ(shelf.store->remove(first), 1U);
  EXPECT_EQ(shelf.store->remove(first), 0U);
  shelf.store->release(held[2].row_id);
  EXPECT_TRUE(shelf.store->has_waiting("a"));
  EXPECT_EQ(shelf.drain(), "a/fast[3]}");
  EXPECT_EQ(shelf.store->rows(), 1U);
  shelf.store->upkeep(kStart, kNow);
  shelf.open();
  EXPECT_EQ(shelf.drain(), "a/fast[2]}");
}

TEST(Store, PausedLaneIsPassedOver) {
  Shelf shelf;
  shelf.open();
  shelf.add(rows(1, 1));
  shelf.add(rows(1, 1, "b"));
  const auto batch =
      shelf.store->next(65536, [](const StreamKey& stream) { return stream.first == "b"; });
  ASSERT_TRUE(batch);
  EXPECT_EQ(batch->device, "b");
  EXPECT_TRUE(shelf.store->is_on_the_way({"b", "fast"}));
}

TEST(Store, FullStoreLetsTheOldestGoAndCountsThem) {
  Shelf shelf;
  shelf.config.max_bytes = 5 * (SampleRow::kOverhead + 1);
  shelf.open();
  shelf.add(rows(1, 2, "b"));
  shelf.add(rows(1, 5));
  EXPECT_EQ(shelf.store->rows(), 5U);
  EXPECT_EQ(shelf.store->take_dropped(), (std::map<std::string, std::uint64_t>{{"b", 2}}));
  const auto batch = shelf.store->next(27, any);  // row 1 is on its way and makes room
  shelf.add(rows(6, 6));
  EXPECT_EQ(shelf.store->take_dropped().at("a"), 1U);
  EXPECT_EQ(shelf.store->remove(*batch), 0U);
  EXPECT_EQ(shelf.store->rows(), 5U);
  EXPECT_LE(shelf.store->bytes(), shelf.config.max_bytes);
  shelf.open();
  EXPECT_EQ(shelf.drain(), "a/fast[2,3,4,5,6]}");
}

TEST(Store, RowsThatAreTooOldGo) {
  Shelf shelf;
  shelf.config.max_age = 1h;
  shelf.open();
  shelf.add(rows(1, 2));
  shelf.store->upkeep(kStart, kNow);
  shelf.store->upkeep(kStart + 30min, kNow + 1800000);
  shelf.add(rows(3, 3));
  shelf.store->upkeep(kStart + 1h, kNow + 3600000);
  EXPECT_TRUE(shelf.store->take_dropped().empty());
  shelf.store->upkeep(kStart + 90min, kNow + 5400000);
  EXPECT_EQ(shelf.store->take_dropped().at("a"), 2U);
  EXPECT_EQ(shelf.drain(), "a/fast[3]}");
}

TEST(Store, ClockThatIsSetMakesNothingOlderOrYounger) {
  Shelf shelf;
  shelf.config.max_age = 1h;
  constexpr std::int64_t kYear = std::int64_t{365} * 24 * 3600 * 1000;
  shelf.open(kNow - kYear);  // a gateway without a clock of its own
  shelf.store->upkeep(kStart, kNow - kYear);
  shelf.add(rows(1, 2));
  JournalEntry order = shelf.arrived("x", {}, kNow - kYear);
  ASSERT_TRUE(shelf.store->journal(std::vector{order}));
  shelf.store->upkeep(kStart + 30min, kNow + 1800000);
  shelf.store->upkeep(kStart + 60min, kNow + 3600000);
  EXPECT_TRUE(shelf.store->take_dropped().empty());
  EXPECT_EQ(shelf.store->unacknowledged().at(0).received_ms, kNow);
  EXPECT_EQ(shelf.store->unacknowledged().at(0).deadline_ms, kNow + 10000);
  shelf.store->upkeep(kStart + 62min, kNow + 3720000);
  EXPECT_EQ(shelf.store->take_dropped().at("a"), 2U);
}

TEST(Store, ClockThatIsSetLeavesRowsOfEarlierRunsAsTheyAre) {
  Shelf shelf;
  shelf.config.max_age = 1h;
  shelf.open();
  shelf.add(rows(1, 2));
  shelf.open(kNow + 1000);
  shelf.store->upkeep(kStart, kNow + 1000);
  shelf.add(rows(3, 3));
  shelf.store->upkeep(kStart + 2min, kNow + 4000000);
  EXPECT_EQ(shelf.store->take_dropped().at("a"), 2U);
  EXPECT_EQ(shelf.drain(), "a/fast[3]}");
}

TEST(Store, DamagedFileIsSetAsideAndAFreshOneBegun) {
  Shelf shelf;
  std::filesystem::create_directories(shelf.config.path);
  std::ofstream(shelf.file()) << std::string(8192, 'x');
  shelf.open();
  EXPECT_EQ(shelf.store->state(), "disk");
  EXPECT_TRUE(std::filesystem::exists(shelf.file() + ".corrupt-" + std::to_string(kNow)));
  EXPECT_TRUE(shelf.add(rows(1, 1)));
  EXPECT_EQ(shelf.drain(), "a/fast[1]}");
}

TEST(Store, DamageInTheMiddleOfTheFileIsFoundAtTheStart) {
  Shelf shelf;
  shelf.open();
  shelf.add(rows(1, 2000));
  shelf.store->close();
  {
    std::fstream file(shelf.file(), std::ios::in | std::ios::out | std::ios::binary);
    file.seekp(4096 * 3);
    file << std::string(4096 * 12, '\xA5');
  }
  shelf.open();
  EXPECT_EQ(shelf.store->state(), "disk");
  EXPECT_EQ(shelf.store->rows(), 0U);
  EXPECT_TRUE(std::filesystem::exists(shelf.file() + ".corrupt-" + std::to_string(kNow)));
}

TEST(Store, FileOfANewerProgramIsSetAside) {
  Shelf shelf;
  shelf.open().close();
  {
    sqlite::Database database(shelf.file());
    ASSERT_TRUE(database.execute("PRAGMA user_version = 99"));
  }
  EXPECT_EQ(shelf.open().state(), "disk");
  EXPECT_TRUE(std::filesystem::exists(shelf.file() + ".corrupt-" + std::to_string(kNow)));
}

TEST(Store, DirectoryThatCannotBeMadeIsTriedAgain) {
  Shelf shelf;
  shelf.block();
  shelf.open();
  EXPECT_EQ(shelf.store->state(), "memory");
  EXPECT_FALSE(shelf.add(rows(1, 1)));
  EXPECT_FALSE(shelf.store->journal(std::vector{entry("x")}));
  EXPECT_EQ(shelf.begin(), static_cast<std::uint64_t>(kNow));
  shelf.store->upkeep(kStart, kNow);
  std::filesystem::remove(shelf.config.path);
  shelf.store->upkeep(kStart + 9s, kNow);
  EXPECT_EQ(shelf.store->state(), "memory");
  shelf.store->upkeep(kStart + 10s, kNow);
  EXPECT_EQ(shelf.store->state(), "disk");
  EXPECT_TRUE(shelf.add(rows(1, 1)));
}

TEST(Store, SecondAgentDoesNotGetTheSameFile) {
  Shelf shelf;
  shelf.open();
  const Store second(shelf.config, kNow);
  EXPECT_EQ(second.state(), "memory");
  EXPECT_EQ(shelf.store->state(), "disk");
}

/// Files of this process end at so many bytes, as on a full disk.
class DiskLimit final {
 public:
  explicit DiskLimit(rlim_t bytes) {
    std::signal(SIGXFSZ, SIG_IGN);
    getrlimit(RLIMIT_FSIZE, &before_);
    rlimit limit = before_;
    limit.rlim_cur = bytes;
    setrlimit(RLIMIT_FSIZE, &limit);
  }
  ~DiskLimit() { setrlimit(RLIMIT_FSIZE, &before_); }
  DiskLimit(const DiskLimit&) = delete;
  DiskLimit& operator=(const DiskLimit&) = delete;

 private:
  rlimit before_{};
};

// Its result was told and then had to make room for newer ones. Nobody is told another one.
TEST(Store, OrderWhoseResultWasToldAndLostIsKnownAndOver) {
  Shelf shelf;
  shelf.open();
  JournalEntry order = shelf.arrived("x");
  ASSERT_TRUE(shelf.store->journal(std::vector{order}));
  shelf.store->upkeep(kStart, kNow);
  {
    const DiskLimit full(1000);
    order.result = "{x}";
    shelf.store->record(order);
    shelf.store->acknowledge("a", "x", order.number);
    for (std::size_t i = 0; i < kRememberedIds; ++i) {
      JournalEntry made = shelf.arrived(std::to_string(i), "{}");
      shelf.store->record(std::move(made));
    }
    EXPECT_EQ(shelf.store->state(), "memory");
  }
  shelf.store->upkeep(kStart + 1s, kNow);
  shelf.store->upkeep(kStart + 11s, kNow);
  ASSERT_EQ(shelf.store->state(), "disk");
  EXPECT_EQ(shelf.store->find("a", "x")->result, "");
  for (const JournalEntry& open : shelf.store->unacknowledged()) EXPECT_NE(open.id, "x");
  const auto ids = shelf.open().known_ids();
  EXPECT_TRUE(
      std::any_of(ids.begin(), ids.end(), [](const auto& known) { return known.id == "x"; }));
}

TEST(Store, OrderIsInTheFreshFileThatTookThePlaceOfADamagedOne) {
  Shelf shelf;
  shelf.open();
  JournalEntry early = entry("early");
  early.audit = R"({"early":1})";
  ASSERT_TRUE(shelf.store->journal(std::vector{early}));
  {
    sqlite::Database other(shelf.file());
    ASSERT_TRUE(other.execute("INSERT INTO audit VALUES(2, '', x'')"));  // in the next one's place
  }
  JournalEntry order = entry("x");
  order.audit = R"({"x":1})";
  EXPECT_TRUE(shelf.store->journal(std::vector{order}));
  EXPECT_NE(shelf.store->set_aside(), "");
  order.result = "{1}";
  shelf.store->record(order);
  EXPECT_EQ(shelf.store->find("a", "x")->result, "{1}");
  EXPECT_EQ(shelf.open().unacknowledged().at(0).id, "x");
}

TEST(Store, FullDiskKeepsWhatItHasAndTakesMoreWhenThereIsRoom) {
  Shelf shelf;
  shelf.open();
  shelf.add(rows(1, 3));
  shelf.store->upkeep(kStart, kNow);
  SteadyTime now = kStart;
  {
    const DiskLimit full(200000);
    std::uint64_t seq = 4;
    do {  // each time the log makes room by going home, until the file itself is as large
      while (shelf.add(rows(seq, seq + 99))) seq += 100;
      EXPECT_EQ(shelf.store->state(), "memory");
      shelf.store->upkeep(now += 1s, kNow);
      shelf.store->upkeep(now += 10s, kNow);
    } while (shelf.store->state() == "disk");
    EXPECT_GT(seq, 500U);
    EXPECT_EQ(shelf.store->rows(), seq - 1);
    const auto batch = shelf.store->next(4096, any);  // reading goes on
    ASSERT_TRUE(batch);
    EXPECT_EQ(shelf.store->remove(*batch), batch->row_ids.size());
    shelf.store->upkeep(now += 10s, kNow);
    EXPECT_EQ(shelf.store->state(), "memory");
  }
  const std::uint64_t left = shelf.store->rows();
  EXPECT_GT(left, 500U);
  shelf.store->upkeep(now += 10s, kNow);
  EXPECT_EQ(shelf.store->state(), "disk");
  EXPECT_TRUE(shelf.add(rows(100000, 100000)));
  EXPECT_EQ(shelf.store->rows(), left + 1);
  shelf.open();
  EXPECT_EQ(shelf.store->rows(), left + 1);
}

TEST(Store, NumbersGoOnByOneAfterACleanStop) {
  Shelf shelf;
  shelf.open();
  EXPECT_EQ(shelf.begin(), static_cast<std::uint64_t>(kNow));
  shelf.store->used_seq("a", kNow + 5);
  shelf.store->close();
  shelf.open();
  EXPECT_EQ(shelf.begin(kNow + 100000), static_cast<std::uint64_t>(kNow) + 5);
}

TEST(Store, NumbersOnlySkipForwardAfterACrash) {
  Shelf shelf;
  shelf.open();
  std::uint64_t used = shelf.begin();
  for (std::uint64_t i = 0; i < 3 * Store::kSequenceBlock; ++i) shelf.store->used_seq("a", ++used);
  // The clock went back: the numbers do not.
  shelf.open(5);
  EXPECT_GT(shelf.begin(5), used);
}

// The file of an earlier run opens in the middle of this one, whose clock began in the past: what
// it writes of its own low numbers must not hide how far the earlier run had come.
TEST(Store, NumbersOfAnEarlierRunAreNotSetBackByAFileThatOpensLate) {
  constexpr std::int64_t kBoot = 5000;
  Shelf shelf;
  shelf.open();
  const std::uint64_t reached = shelf.begin() + Store::kSequenceBlock;
  shelf.store.reset();
  const std::string away = shelf.config.path + "-away";
  std::filesystem::rename(shelf.config.path, away);
  shelf.block();
  shelf.open(kBoot);
  ASSERT_EQ(shelf.begin(kBoot), static_cast<std::uint64_t>(kBoot));
  shelf.store->upkeep(kStart, kBoot);
  std::filesystem::remove(shelf.config.path);
  std::filesystem::rename(away, shelf.config.path);
  shelf.store->upkeep(kStart + 10s, kBoot + 10000);
  ASSERT_EQ(shelf.store->state(), "disk");
  shelf.open(kBoot + 20000);  // after a crash
  EXPECT_GE(shelf.begin(kBoot + 20000), reached);
}

TEST(Store, NextBlockOfNumbersIsTakenWhileHalfOfTheLastOneIsLeft) {
  Shelf shelf;
  shelf.open();
  const std::uint64_t first = shelf.begin();
  shelf.store->used_seq("a", first + Store::kSequenceBlock / 2);
  EXPECT_FALSE(shelf.store->has_pending());
  shelf.store->used_seq("a", first + Store::kSequenceBlock / 2 + 1);
  EXPECT_TRUE(shelf.store->has_pending());
  shelf.store->upkeep(kStart, kNow);
  EXPECT_FALSE(shelf.store->has_pending());
  shelf.open();
  EXPECT_GE(shelf.begin(), first + 3 * Store::kSequenceBlock / 2);
}

TEST(Store, WithAlwaysNumbersGoOnByOneEvenAfterACrash) {
  Shelf shelf;
  shelf.config.sync_always = true;
  shelf.open();
  const std::uint64_t last = shelf.begin();
  for (std::uint64_t seq = last + 1; seq < last + 4; ++seq) {
    shelf.store->used_seq("a", seq);
    ASSERT_TRUE(shelf.add(rows(seq, seq)));
  }
  shelf.open();
  EXPECT_EQ(shelf.begin(kNow + 100000), last + 3);
}

TEST(Store, WithAlwaysNumbersThatTheDiskRefusedAreNotUsedAgain) {
  Shelf shelf;
  shelf.config.sync_always = true;
  shelf.open();
  std::uint64_t last = shelf.begin();
  {
    const DiskLimit full(200000);
    do {
      ++last;
      shelf.store->used_seq("a", last);
    } while (shelf.add(rows(last, last)));
    for (int i = 0; i < 1000; ++i) shelf.store->used_seq("a", ++last);
  }  // and the power goes
  shelf.open(5);
  const std::uint64_t next = shelf.begin(5);
  EXPECT_GT(next, last);
  shelf.open();  // the mark has done its work
  EXPECT_EQ(shelf.begin(), next);
}

TEST(Store, JournalRemembersOrdersAndTheirFirstResult) {
  Shelf shelf;
  shelf.open();
  ASSERT_TRUE(shelf.store->journal(std::vector{entry("one"), entry("two")}));
  shelf.store->record(entry("one", "{1}"));
  shelf.store->record(entry("one", "{2}"));
  shelf.store->record(entry("three", "{3}", kNow + 1));
  shelf.store->acknowledge("a", "three", 0);
  shelf.store->upkeep(kStart, kNow);
  shelf.open();
  const auto ids = shelf.store->known_ids();
  ASSERT_EQ(ids.size(), 2U);
  EXPECT_EQ(ids[0].id, "one");
  EXPECT_EQ(ids[1].id, "three");
  EXPECT_EQ(ids[1].device, "a");
  EXPECT_EQ(ids[1].received_ms, kNow + 1);
  const auto open = shelf.store->unacknowledged();
  ASSERT_EQ(open.size(), 2U);
  EXPECT_EQ(open[0].id, "one");
  EXPECT_EQ(open[0].result, "{1}");
  EXPECT_FALSE(open[0].acknowledged);
  EXPECT_EQ(open[1].result, "");
  EXPECT_EQ(open[1].response_topic, "hmi/replies");
  EXPECT_EQ(open[1].correlation, (Bytes{1, 0, 255}));
  EXPECT_EQ(open[1].deadline_ms, kNow + 10000);
  const auto three = shelf.store->find("a", "three");
  ASSERT_TRUE(three);
  EXPECT_EQ(three->result, "{3}");
  EXPECT_TRUE(three->acknowledged);
  EXPECT_EQ(three->response_topic, "");  // nobody needs it any more
  EXPECT_EQ(three->correlation, Bytes{});
}

// The field forgets the oldest of 10,000 ids at once, and the file once a minute.
TEST(Store, IdThatIsUsedAnewIsAnotherOrder) {
  Shelf shelf;
  shelf.open();
  JournalEntry first = entry("one");
  first.number = 7;
  JournalEntry again = entry("one", "", kNow + 60000);
  again.number = 8;
  again.op = "read";
  ASSERT_TRUE(shelf.store->journal(std::vector{first}));
  first.result = "{1}";
  shelf.store->record(first);
  shelf.store->upkeep(kStart, kNow);
  ASSERT_TRUE(shelf.store->journal(std::vector{first}));  // not another command
  EXPECT_EQ(shelf.store->find("a", "one")->result, "{1}");
  ASSERT_TRUE(shelf.store->journal(std::vector{again}));
  const auto found = shelf.store->find("a", "one");
  ASSERT_TRUE(found);
  EXPECT_EQ(found->result, "");
  EXPECT_FALSE(found->acknowledged);
  EXPECT_EQ(found->op, "read");
  EXPECT_EQ(found->received_ms, kNow + 60000);
  shelf.store->record(first);
  shelf.store->acknowledge("a", "one", 7);  // of the first, and late
  shelf.store->upkeep(kStart + 1s, kNow);
  EXPECT_EQ(shelf.store->find("a", "one")->result, "");
  again.result = "{2}";
  shelf.store->record(again);
  EXPECT_EQ(shelf.store->find("a", "one")->result, "{2}");
  EXPECT_FALSE(shelf.store->find("a", "one")->acknowledged);
  JournalEntry refused = entry("one", "{3}", kNow + 120000);  // it was never admitted
  refused.number = 9;
  shelf.store->record(refused);
  EXPECT_EQ(shelf.store->find("a", "one")->result, "{3}");
  shelf.store->acknowledge("a", "one", 9);
  shelf.store->upkeep(kStart + 2s, kNow);
  EXPECT_TRUE(shelf.store->find("a", "one")->acknowledged);
}

TEST(Store, IdsAreForgottenAfterADayAndNotBeforeTheirDeadline) {
  Shelf shelf;
  shelf.open();
  const std::int64_t day = 24 * 3600 * 1000;
  // An hour more than the field knows them, so that it finds what it asks for.
  for (const std::int64_t age : {day + 3620000, day + 3580000}) {
    const std::string id = std::to_string(age);
    shelf.store->record(entry(id, "{}", kNow - age));
    shelf.store->acknowledge("a", id, 0);
  }
  JournalEntry late = entry("late", "{}", kNow - 2 * day);
  late.deadline_ms = kNow + 1;
  shelf.store->record(late);
  shelf.store->acknowledge("a", "late", 0);
  shelf.store->upkeep(kStart, kNow);
  const auto found = shelf.store->known_ids();
  ASSERT_EQ(found.size(), 2U);
  EXPECT_EQ(found[0].id, "late");
  EXPECT_EQ(found[1].id, std::to_string(day + 3580000));
}

TEST(Store, OfTheOldestIdsTheResultsGoAndTheIdsStay) {
  Shelf shelf;
  shelf.open();
  for (std::size_t i = 0; i < kRememberedIds + 5; ++i) {
    const std::int64_t at = kNow - 100000 + static_cast<std::int64_t>(i);
    shelf.store->record(entry(std::to_string(i), "{}", at));
    shelf.store->acknowledge("a", std::to_string(i), 0);
    if (i % 1000 == 0) shelf.store->upkeep(kStart + std::chrono::seconds(i), kNow - 200000);
  }
  shelf.store->upkeep(kStart + 10h, kNow);
  const auto found = shelf.store->known_ids();
  EXPECT_EQ(found.size(), kRememberedIds + 5) << "every id is known";
  EXPECT_EQ(shelf.store->find("a", "4")->result, "");
  EXPECT_EQ(shelf.store->find("a", "5")->result, "{}");
}

// Whatever the calendar says: an id that came after 10,000 others is a new one, and what nobody was
// told is never passed over.
TEST(Store, NewestIdsAreThoseThatCameLast) {
  Shelf shelf;
  shelf.open();
  constexpr std::int64_t kHour = 3600000;
  for (std::size_t i = 0; i < kRememberedIds; ++i) {
    JournalEntry made = shelf.arrived(std::to_string(i), "{}", kNow + static_cast<std::int64_t>(i));
    shelf.store->record(made);
    if (i != 0) shelf.store->acknowledge("a", made.id, made.number);
    if (i % 1000 == 0) shelf.store->upkeep(kStart + std::chrono::milliseconds(i), kNow);
  }
  for (const char* id : {"x", "y"}) {  // the clock was set back
    JournalEntry made = shelf.arrived(id, "{}", kNow - kHour);
    shelf.store->record(made);
    shelf.store->acknowledge("a", made.id, made.number);
  }
  shelf.store->upkeep(kStart + 20s, kNow + 20000);
  shelf.open(kNow + kHour);
  shelf.store->upkeep(kStart, kNow + kHour);
  const auto found = shelf.store->known_ids();
  ASSERT_EQ(found.size(), kRememberedIds + 2);
  EXPECT_EQ(shelf.store->find("a", "1")->result, "");
  EXPECT_EQ(shelf.store->find("a", "2")->result, "{}");
  EXPECT_EQ(found.back().id, "y");
  ASSERT_EQ(shelf.store->unacknowledged().size(), 1U);
  EXPECT_EQ(shelf.store->unacknowledged()[0].id, "0");  // too many ago, but nobody was told
}

TEST(Store, IdIsKeptUntilItsTimeIsOverHoweverManyFollow) {
  Shelf shelf;
  shelf.open();
  JournalEntry patient = entry("patient", "{}");
  patient.deadline_ms = kNow + 3600000;
  patient.number = shelf.store->next_command_number();
  shelf.store->record(patient);
  shelf.store->acknowledge("a", "patient", patient.number);
  shelf.store->upkeep(kStart, kNow);
  for (std::size_t i = 0; i < kRememberedIds; ++i) {
    JournalEntry made = shelf.arrived(std::to_string(i), "{}", kNow + 1000);
    shelf.store->record(made);
  }
  shelf.open(kNow + 1800000);
  shelf.store->upkeep(kStart, kNow + 1800000);
  EXPECT_EQ(shelf.store->known_ids().front().id, "patient");
  EXPECT_EQ(shelf.store->known_ids().size(), kRememberedIds + 1);
  shelf.open(kNow + 3600001);
  shelf.store->upkeep(kStart, kNow + 3600001);
  EXPECT_EQ(shelf.store->known_ids().size(), kRememberedIds + 1);
  EXPECT_EQ(shelf.store->find("a", "patient")->result, "");
}

TEST(Store, OrdersCountIntoTheLimitAndTheOldestSamplesMakeRoom) {
  Shelf shelf;
  shelf.config.max_bytes = 1 << 20;
  shelf.open();
  std::vector<SampleRow> samples = rows(1, 3);
  for (SampleRow& row : samples) row.json = std::string(250000, 'x');
  ASSERT_TRUE(shelf.add(samples));
  for (int i = 0; i < 6; ++i) {
    JournalEntry order = shelf.arrived(std::to_string(i));
    order.payload = std::string(65536, 'p');
    ASSERT_TRUE(shelf.store->journal(std::vector{order}));
  }
  EXPECT_GT(shelf.store->bytes(), shelf.store->max_bytes());
  shelf.store->upkeep(kStart, kNow);
  EXPECT_LE(shelf.store->bytes(), shelf.store->max_bytes());
  EXPECT_EQ(shelf.store->rows(), 2U);
  EXPECT_EQ(shelf.store->take_dropped().at("a"), 1U);
  const std::uint64_t bytes = shelf.store->bytes();
  EXPECT_EQ(shelf.open().bytes(), bytes) << "counted anew as they were counted on their way";
}

TEST(Store, ResultsAboveTheShareOfOrdersGoAndTheIdsStay) {
  Shelf shelf;
  shelf.config.max_bytes = 1 << 20;
  shelf.open();
  for (int i = 0; i < 30; ++i) {
    JournalEntry made = shelf.arrived(std::to_string(i), std::string(60000, 'r'));
    shelf.store->record(made);
    shelf.store->acknowledge("a", made.id, made.number);
  }
  for (int i = 0; i < 5; ++i) shelf.store->upkeep(kStart + i * 1s, kNow + i * 1000);
  EXPECT_LE(shelf.store->bytes(), shelf.store->max_bytes() / 2);
  EXPECT_EQ(shelf.store->known_ids().size(), 30U);
}

TEST(Store, CommandsThatWereRefusedDoNotFillTheFile) {
  Shelf shelf;
  shelf.open();
  for (std::size_t i = 0; i < 10500; ++i) {
    JournalEntry made = shelf.arrived(std::to_string(i), "{}");
    made.refused = true;
    shelf.store->record(made);
  }
  EXPECT_LE(shelf.store->known_ids().size(), 10000U);
  EXPECT_FALSE(shelf.store->find("a", "0"));
  EXPECT_TRUE(shelf.store->find("a", "10499"));
  EXPECT_TRUE(shelf.store->known_ids().front().refused);
}

TEST(Store, ResultsThatNobodyTakesDoNotFillTheDisk) {
  Shelf shelf;
  shelf.open();
  for (std::size_t i = 0; i < kRememberedIds + 3; ++i) {
    JournalEntry made = shelf.arrived(std::to_string(i), "{}");
    shelf.store->record(made);
  }
  shelf.store->upkeep(kStart, kNow + 20000);
  EXPECT_FALSE(shelf.store->find("a", "2"));
  EXPECT_TRUE(shelf.store->find("a", "3"));
}

TEST(Store, ResultThatNobodyWasToldIsKeptAsLongAsASample) {
  Shelf shelf;
  shelf.config.max_age = std::chrono::hours(48);
  shelf.open();
  const std::int64_t hour = 3600000;
  shelf.store->record(entry("older", "{}", kNow - 49 * hour));
  shelf.store->record(entry("old", "{}", kNow - 47 * hour));
  shelf.store->upkeep(kStart, kNow);
  const auto waiting = shelf.store->unacknowledged();
  ASSERT_EQ(waiting.size(), 1U);
  EXPECT_EQ(waiting[0].id, "old");
}

// The result of the first one found no disk, and the id was let go: the command that is carried out
// now is the one that a restart must know of.
TEST(Store, OrderTakesThePlaceOfAnEarlierOneWithoutAResult) {
  Shelf shelf;
  shelf.open();
  JournalEntry order = shelf.arrived("x");
  ASSERT_TRUE(shelf.store->journal(std::vector{order}));
  JournalEntry anew = shelf.arrived("x");
  ASSERT_TRUE(shelf.store->journal(std::vector{anew}));
  order.result = "{1}";
  shelf.store->record(order);
  EXPECT_EQ(shelf.store->find("a", "x")->number, anew.number);
  EXPECT_EQ(shelf.store->find("a", "x")->result, "");
}

// A clock that is set while a command is under way: its result does not make it old.
TEST(Store, ResultLeavesTheTimeOfItsOrder) {
  Shelf shelf;
  shelf.open();
  JournalEntry order = shelf.arrived("x");
  ASSERT_TRUE(shelf.store->journal(std::vector{order}));
  order.result = "{}";
  order.received_ms = order.deadline_ms = 5000;
  shelf.store->record(order);
  EXPECT_EQ(shelf.store->find("a", "x")->received_ms, kNow);
  EXPECT_EQ(shelf.store->find("a", "x")->deadline_ms, kNow + 10000);
}

TEST(Store, ResultThatFoundNoDiskIsWrittenLater) {
  Shelf shelf;
  shelf.block();
  shelf.open();
  shelf.store->record(entry("one", "{1}"));
  shelf.store->acknowledge("a", "one", 0);
  std::filesystem::remove(shelf.config.path);
  shelf.store->upkeep(kStart, kNow);
  shelf.store->upkeep(kStart + 10s, kNow);
  ASSERT_EQ(shelf.store->known_ids().size(), 1U);
  EXPECT_EQ(shelf.store->find("a", "one")->result, "{1}");
  EXPECT_TRUE(shelf.store->find("a", "one")->acknowledged);
}

TEST(Store, OrderThatFoundNoDiskIsInTheJournalLater) {
  Shelf shelf;
  shelf.block();
  shelf.open();
  const std::vector<JournalEntry> orders{entry("waits", ""), entry("done", "")};
  EXPECT_FALSE(shelf.store->journal(orders));
  shelf.store->record(entry("done", "{1}"));
  shelf.store->record(entry("done", "{2}"));  // the first one stays, as in the file
  EXPECT_EQ(shelf.store->find("a", "waits")->result, "");
  EXPECT_EQ(shelf.store->find("a", "done")->result, "{1}");
  EXPECT_EQ(shelf.store->find("a", "done")->deadline_ms, kNow + 10000);
  EXPECT_FALSE(shelf.store->find("a", "never"));
  std::filesystem::remove(shelf.config.path);
  shelf.store->upkeep(kStart, kNow);
  shelf.store->upkeep(kStart + 10s, kNow);
  const auto found = shelf.store->unacknowledged();
  ASSERT_EQ(found.size(), 2U);
  const bool done_first = found[0].id == "done";
  EXPECT_EQ(found[done_first ? 0 : 1].result, "{1}");
  EXPECT_EQ(found[done_first ? 1 : 0].id, "waits");
  EXPECT_EQ(found[done_first ? 1 : 0].result, "");
}

// A gateway without a clock of its own whose data partition is mounted late: the numbers of its
// commands begin below those of earlier runs, and the clock is set after the file has opened.
TEST(Store, FileThatOpensBeforeTheClockIsSetKeepsItsOrderAndItsTimes) {
  constexpr std::int64_t kBoot = 5000;
  Shelf shelf;
  shelf.open();
  for (const char* id : {"told", "again", "untold"}) {
    JournalEntry made = entry(id, "{earlier}", kNow - 60000);
    made.number = static_cast<std::uint64_t>(kNow);  // as a run that opened its file late counts
    shelf.store->record(made);
    if (made.id != "untold") shelf.store->acknowledge("a", id, made.number);
  }
  shelf.store->upkeep(kStart, kNow);
  shelf.store.reset();
  const std::string away = shelf.config.path + "-away";
  std::filesystem::rename(shelf.config.path, away);
  shelf.block();
  shelf.open(kBoot);
  shelf.store->upkeep(kStart, kBoot);
  JournalEntry again = shelf.arrived("again", "", kBoot);
  EXPECT_FALSE(shelf.store->journal(std::vector{again}));
  std::filesystem::remove(shelf.config.path);
  std::filesystem::rename(away, shelf.config.path);
  shelf.store->upkeep(kStart + 10s, kBoot + 10000);
  ASSERT_EQ(shelf.store->state(), "disk");
  EXPECT_EQ(shelf.store->find("a", "again")->result, "");  // it is this run's
  shelf.store->upkeep(kStart + 20s, kNow + 20000);
  shelf.store->upkeep(kStart + 21s, kNow + 21000);
  EXPECT_EQ(shelf.store->find("a", "told")->received_ms, kNow - 60000);
  EXPECT_EQ(shelf.store->find("a", "untold")->received_ms, kNow - 60000);
  EXPECT_EQ(shelf.store->find("a", "again")->received_ms, kNow);
  const auto ids = shelf.store->known_ids();
  ASSERT_EQ(ids.size(), 2U);
  EXPECT_EQ(ids[0].id, "told");
}

TEST(Store, ClockThatIsSetTwiceWithoutADiskMovesWhatWasThere) {
  constexpr std::int64_t kHour = 3600000;
  Shelf shelf;
  shelf.block();
  shelf.open();
  shelf.store->upkeep(kStart, kNow);
  const auto journal = [&](const char* id, std::int64_t at) {
    JournalEntry made = shelf.arrived(id, "", at);
    shelf.store->journal(std::vector{made});
  };
  journal("first", kNow);
  shelf.store->upkeep(kStart + 1s, kNow + 30 * kHour + 1000);
  journal("between", kNow + 30 * kHour + 1000);
  shelf.store->upkeep(kStart + 2s, kNow - 50 * kHour + 2000);
  journal("last", kNow - 50 * kHour + 2000);
  std::filesystem::remove(shelf.config.path);
  shelf.store->upkeep(kStart + 20s, kNow - 50 * kHour + 20000);
  ASSERT_EQ(shelf.store->state(), "disk");
  EXPECT_EQ(shelf.store->find("a", "first")->received_ms, kNow - 50 * kHour);
  EXPECT_EQ(shelf.store->find("a", "between")->received_ms, kNow - 50 * kHour + 1000);
  EXPECT_EQ(shelf.store->find("a", "last")->received_ms, kNow - 50 * kHour + 2000);
}

// The disk may be away for a day: a command and its result take one place between them, and an id
// that is used anew takes its own place again.
TEST(Store, TenThousandOrdersFindRoomUntilThereIsADisk) {
  Shelf shelf;
  shelf.block();
  shelf.open();
  const auto make = [](std::size_t i, std::uint64_t number) {
    JournalEntry made = entry(std::to_string(i), "");
    made.number = number;
    return made;
  };
  for (std::size_t i = 0; i < kRememberedIds; ++i) {
    JournalEntry made = make(i, 1 + i);
    EXPECT_FALSE(shelf.store->journal(std::vector{made}));
    made.result = "{" + std::to_string(i) + "}";
    shelf.store->record(std::move(made));
  }
  shelf.store->journal(std::vector{make(7, 20000)});  // anew
  JournalEntry late = make(7, 8);
  late.result = "{late}";
  shelf.store->record(std::move(late));                            // of the first one
  shelf.store->journal(std::vector{make(kRememberedIds, 20001)});  // one too many: the oldest goes
  EXPECT_EQ(shelf.store->find("a", "7")->result, "");
  EXPECT_FALSE(shelf.store->find("a", "0"));
  std::filesystem::remove(shelf.config.path);
  shelf.store->upkeep(kStart, kNow);
  shelf.store->upkeep(kStart + 10s, kNow);
  ASSERT_EQ(shelf.store->state(), "disk");
  EXPECT_EQ(shelf.store->known_ids().size(), kRememberedIds - 2);
  EXPECT_EQ(shelf.store->unacknowledged().back().id, std::to_string(kRememberedIds));
  EXPECT_EQ(shelf.store->find("a", "9999")->result, "{9999}");
  EXPECT_EQ(shelf.store->find("a", "7")->result, "");
  EXPECT_EQ(shelf.store->find("a", "7")->number, 20000U);
}

// ---- the audit

/// The records of the file, as another process reads them; their chain is whole.
std::vector<std::string> audit_of(const Shelf& shelf) {
  sqlite::Database database(shelf.file(), sqlite::Database::Access::read_only);
  std::vector<std::string> texts;
  audit::Verifier verifier;
  audit::Head head;
  EXPECT_TRUE(AuditTrail::read(
      database,
      [&](const audit::Record& record) {
        verifier.add(record);
        texts.push_back(record.text);
      },
      head))
      << database.fault().text;
  for (const audit::Finding& finding : verifier.finish(head))
    ADD_FAILURE() << finding.record << ": " << finding.text;
  return texts;
}

std::string told(const std::string& id) { return audit::told(1, "a", id, true, kNow); }

TEST(Store, AuditOfAnOrderIsWrittenWithItsJournal) {
  Shelf shelf;
  shelf.open();
  JournalEntry order = entry("one");
  order.audit = told("one");
  order.number = 7;
  order.payload = "{}";
  ASSERT_TRUE(shelf.store->journal(std::vector{order}));
  EXPECT_EQ(audit_of(shelf).size(), 1U);
  EXPECT_EQ(shelf.store->unacknowledged().at(0).number, 7U);
  EXPECT_EQ(shelf.store->unacknowledged().at(0).payload, "{}");
  order.result = "{1}";
  shelf.store->record(order);
  EXPECT_EQ(audit_of(shelf).size(), 2U);
  EXPECT_EQ(shelf.store->unacknowledged().at(0).payload, "");  // it has done its work
  EXPECT_EQ(shelf.store->audit_head().records, 2U);
}

TEST(Store, NotesForTheAuditAreWrittenTogether) {
  Shelf shelf;
  shelf.open();
  shelf.store->upkeep(kStart, kNow);
  for (const char* id : {"a", "b", "c"}) shelf.store->note(told(id));
  EXPECT_TRUE(shelf.store->has_pending());
  EXPECT_EQ(shelf.store->audit_head().records, 0U);
  shelf.store->upkeep(kStart + 200ms, kNow + 200);
  EXPECT_FALSE(shelf.store->has_pending());
  EXPECT_EQ(audit_of(shelf).size(), 3U);
}

TEST(Store, AuditGoesOnAfterARestartAndCommandsKeepTheirNumbers) {
  Shelf shelf;
  shelf.open();
  EXPECT_EQ(shelf.store->next_command_number(), 1U);
  EXPECT_EQ(shelf.store->next_command_number(), 2U);
  shelf.store->note(told("a"));
  shelf.store->close();
  EXPECT_EQ(audit_of(shelf).size(), 1U);  // without an agent, too
  shelf.open();
  EXPECT_EQ(shelf.store->next_command_number(), 3U);
  shelf.store->note(told("b"));
  shelf.store->upkeep(kStart, kNow);
  EXPECT_EQ(audit_of(shelf).size(), 2U);
}

TEST(Store, AuditThatFoundNoDiskIsWrittenLaterAndSaysWhatWasLost) {
  Shelf shelf;
  shelf.block();
  shelf.open();
  JournalEntry order = entry("one");
  order.audit = told("one");
  EXPECT_FALSE(shelf.store->journal(std::vector{order}));
  for (int i = 0; i < 30005; ++i) shelf.store->note(told("x"));
  std::filesystem::remove(shelf.config.path);
  shelf.store->upkeep(kStart, kNow);
  shelf.store->upkeep(kStart + 10s, kNow + 10000);
  const auto texts = audit_of(shelf);
  ASSERT_EQ(texts.size(), 30001U);
  EXPECT_NE(texts.front().find("\"one\""), std::string::npos);
  EXPECT_NE(texts.back().find("\"kind\":\"lost\",\"ts\":1790000010000,\"records\":6"),
            std::string::npos)
      << texts.back();
}

TEST(Store, AuditOfAFreshFileNamesTheDamagedOne) {
  Shelf shelf;
  std::filesystem::create_directories(shelf.config.path);
  std::ofstream(shelf.file()) << std::string(8192, 'x');
  shelf.open();
  shelf.store->upkeep(kStart, kNow);
  const auto texts = audit_of(shelf);
  ASSERT_EQ(texts.size(), 1U);
  EXPECT_NE(texts[0].find(shelf.store->set_aside()), std::string::npos) << texts[0];
}

TEST(Store, AuditIsPrunedToItsSizeAndItsAge) {
  Shelf shelf;
  shelf.config.audit_max_bytes = 20000;
  shelf.config.audit_max_age = 1h;
  shelf.open();
  for (int i = 0; i < 500; ++i) shelf.store->note(told("x"));
  shelf.store->upkeep(kStart, kNow);
  EXPECT_LT(audit_of(shelf).size(), 150U);
  EXPECT_GT(audit_of(shelf).size(), 50U);
  shelf.open(kNow + 7200000);
  shelf.store->upkeep(kStart, kNow + 7200000);
  // The last one has to stay, and with it what says that the others were let go.
  EXPECT_EQ(audit_of(shelf).size(), 2U);
}

/// What the first version of the program made.
constexpr const char* kFirstSchema =
    "CREATE TABLE samples(id INTEGER PRIMARY KEY, device TEXT NOT NULL, grp TEXT NOT NULL,"
    " seq INTEGER NOT NULL, created_ms INTEGER NOT NULL, row TEXT NOT NULL);"
    "CREATE INDEX samples_by_lane ON samples(device, grp, seq, id);"
    "CREATE TABLE devices(name TEXT PRIMARY KEY, last_seq INTEGER NOT NULL,"
    " clean INTEGER NOT NULL) WITHOUT ROWID;"
    "CREATE TABLE orders(device TEXT NOT NULL, id TEXT NOT NULL, received_ms INTEGER NOT NULL,"
    " deadline_ms INTEGER NOT NULL, op TEXT NOT NULL, response_topic TEXT NOT NULL,"
    " correlation BLOB NOT NULL, result TEXT NOT NULL, told INTEGER NOT NULL,"
    " PRIMARY KEY(device, id)) WITHOUT ROWID;"
    "CREATE INDEX orders_by_age ON orders(device, received_ms);"
    "PRAGMA user_version = 1;"
    "INSERT INTO samples VALUES(1, 'a', 'fast', 5, 1790000000000, '5');"
    "INSERT INTO devices VALUES('a', 5, 1);"
    "INSERT INTO orders VALUES('a', 'done', 1790000000000, 1790000010000, 'write', '', x'01',"
    " '{1}', 1);"
    "INSERT INTO orders VALUES('a', 'open', 1790000000001, 1790000010000, 'write', '', x'',"
    " '', 0);";

TEST(Store, FileOfTheFirstVersionIsTakenOver) {
  Shelf shelf;
  std::filesystem::create_directories(shelf.config.path);
  {
    sqlite::Database old(shelf.file());
    ASSERT_TRUE(old.execute("PRAGMA journal_mode = WAL"));
    ASSERT_TRUE(old.execute(kFirstSchema)) << old.fault().text;
  }
  shelf.open();
  EXPECT_EQ(shelf.store->state(), "disk");
  EXPECT_EQ(shelf.store->set_aside(), "");
  EXPECT_EQ(shelf.begin(), 5U);
  ASSERT_EQ(shelf.store->known_ids().size(), 1U);
  const auto known = shelf.store->find("a", shelf.store->known_ids()[0].id);
  EXPECT_EQ(known->result, "{1}");
  EXPECT_EQ(known->correlation, Bytes{1});
  EXPECT_TRUE(known->acknowledged);
  ASSERT_EQ(shelf.store->unacknowledged().size(), 1U);
  JournalEntry result = shelf.store->unacknowledged()[0];
  EXPECT_EQ(result.number, 0U);
  EXPECT_EQ(shelf.drain(), "a/fast[5]}");
  result.result = "{2}";
  result.audit = told("open");
  shelf.store->record(result);
  EXPECT_EQ(audit_of(shelf).size(), 1U);
  EXPECT_EQ(shelf.open().unacknowledged().at(0).result, "{2}");
}

TEST(Migration, StepsRunOnceInTheirOrderAndAFailedOneLeavesNothing) {
  const test::Scratch scratch;
  sqlite::Database database(scratch.path("x.db"));
  const char* first[] = {"CREATE TABLE t(a); INSERT INTO t VALUES(1)"};
  ASSERT_TRUE(sqlite::migrate(database, first));
  const char* broken[] = {first[0], "INSERT INTO t VALUES(2); no SQL"};
  EXPECT_FALSE(sqlite::migrate(database, broken));
  EXPECT_EQ(database.number("SELECT sum(a) FROM t"), 1);
  const char* second[] = {first[0], "ALTER TABLE t ADD b DEFAULT 7; UPDATE t SET a = 3"};
  ASSERT_TRUE(sqlite::migrate(database, second));
  ASSERT_TRUE(sqlite::migrate(database, second));
  EXPECT_EQ(database.number("SELECT sum(a + b) FROM t"), 10);
  EXPECT_EQ(database.number("PRAGMA user_version"), 2);
  EXPECT_FALSE(sqlite::migrate(database, first));
  EXPECT_EQ(database.fault().code, SQLITE_SCHEMA);
}

}  // namespace
}  // namespace fxagent
