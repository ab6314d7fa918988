#include "agent/store/journal/stored_journal.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>

#include "tests/agent/store/shelf.h"

namespace fxagent {
namespace {

using namespace std::chrono_literals;
using namespace test;

struct StoredJournalTest : ::testing::Test {
  OpenShelf shelf;
};

// The result was published and then dropped to make room. A different result must not be published.
TEST_F(StoredJournalTest, CommandWhoseResultWasPublishedAndLostIsKnownAndOver) {
  JournalEntry command = shelf.arrived("x");
  ASSERT_TRUE(shelf.journal(command));
  shelf.store->upkeep(kStart, kNow);
  {
    const DiskLimit full(1000);
    command.result = "{x}";
    shelf.record_acknowledged(command);
    for (std::size_t i = 0; i < kRememberedIds; ++i) {
      shelf.record(shelf.arrived(std::to_string(i), "{}"));
    }
    EXPECT_EQ(shelf.store->state(), "memory");
  }
  shelf.store->upkeep(kStart + 1s, kNow);
  shelf.store->upkeep(kStart + 11s, kNow);
  ASSERT_EQ(shelf.store->state(), "disk");
  EXPECT_EQ(shelf.found("x")->result, "");
  for (const JournalEntry& open : shelf.store->journal().unacknowledged()) EXPECT_NE(open.id, "x");
  const auto ids = shelf.open().journal().known_ids();
  EXPECT_TRUE(
      std::any_of(ids.begin(), ids.end(), [](const auto& known) { return known.id == "x"; }));
}

TEST_F(StoredJournalTest, ManyCommandsAreReadWithoutATemporaryFile) {
  constexpr std::size_t kMany = 20000;
  constexpr std::size_t kLarge = 60;
  const std::string long_id(200, 'x');
  std::vector<JournalEntry> results;
  for (std::size_t i = 0; i < kMany; ++i)
    results.push_back(entry(long_id + std::to_string(i), "{}"));
  for (std::size_t i = 0; i < kLarge; ++i)
    results.push_back(shelf.arrived(std::to_string(i), std::string(65536, 'x')));
  shelf.store->journal().record(std::move(results));
  const DiskLimit full(4096);
  EXPECT_EQ(shelf.store->journal().known_ids().size(), kMany + kLarge);
  const auto unacknowledged = shelf.store->journal().unacknowledged();
  ASSERT_EQ(unacknowledged.size(), kRememberedIds);
  EXPECT_EQ(unacknowledged.back().id, std::to_string(kLarge - 1));
}

TEST_F(StoredJournalTest, CommandAndItsPlaceComeBackAsTwoFromOneColumn) {
  for (const std::string place : {"", "0123456789abcdef"})
    for (const std::string payload : {"{\"id\":7}", "{} ", "{}\r\n\t"}) {
      JournalEntry command = shelf.arrived(place + payload);
      command.payload = payload;
      command.place = place;
      ASSERT_TRUE(shelf.journal(command));
      const auto found = shelf.found(command.id);
      EXPECT_EQ(found->payload, payload);
      EXPECT_EQ(found->place, place);
    }
}

TEST_F(StoredJournalTest, UnwrittenIsEveryEntryOfWhichTheDiskHasRefusedAPart) {
  StoredJournal& journal = shelf.store->journal();
  JournalEntry early = shelf.arrived("early");
  ASSERT_TRUE(journal.journal(std::vector{early}));
  shelf.store->upkeep(kStart, kNow);
  EXPECT_TRUE(journal.unwritten().empty());
  {
    const DiskLimit full(1000);
    early.result = "{1}";
    journal.record(early);
    journal.acknowledge("a", "early", early.number);
    EXPECT_FALSE(journal.journal(std::vector{shelf.arrived("late")}));
    const auto unwritten = journal.unwritten();
    ASSERT_EQ(unwritten.size(), 2U);
    EXPECT_EQ(unwritten.at(0).id, "early");
    EXPECT_EQ(unwritten.at(0).result, "{1}");
    EXPECT_EQ(unwritten.at(0).number, early.number);
    EXPECT_TRUE(unwritten.at(0).acknowledged);
    EXPECT_EQ(unwritten.at(1).id, "late");
    EXPECT_FALSE(unwritten.at(1).acknowledged);
  }
  shelf.store->upkeep(kStart + 1s, kNow);
  shelf.store->upkeep(kStart + 11s, kNow);
  EXPECT_TRUE(journal.unwritten().empty());
}

TEST_F(StoredJournalTest, AcknowledgementOfAnEarlierCommandWithTheSameIdIsNotThatOfTheLater) {
  StoredJournal& journal = shelf.store->journal();
  const JournalEntry early = shelf.arrived("x", "{1}");
  shelf.record(early);
  shelf.store->upkeep(kStart, kNow);
  const DiskLimit full(1000);
  EXPECT_FALSE(shelf.journal(shelf.arrived("x")));
  journal.acknowledge("a", "x", early.number);
  ASSERT_EQ(journal.unwritten().size(), 1U);
  EXPECT_FALSE(journal.unwritten().at(0).acknowledged);
}

TEST_F(StoredJournalTest, AcknowledgedResultStaysAcknowledgedWhenALaterCommandHasItsId) {
  const JournalEntry early = shelf.arrived("x", "{}");
  shelf.record(early);
  const DiskLimit full(1000);
  ASSERT_FALSE(shelf.journal(shelf.arrived("x")));
  shelf.store->journal().acknowledge(early.device, early.id, early.number);
  const auto open = shelf.store->journal().unacknowledged();
  ASSERT_EQ(open.size(), 1U);
  EXPECT_GT(open[0].number, early.number);
}

TEST_F(StoredJournalTest, CommandIsInTheFreshFileThatTookThePlaceOfADamagedOne) {
  JournalEntry early = entry("early");
  early.audit = R"({"early":1})";
  ASSERT_TRUE(shelf.journal(early));
  {
    SQLite::Database other = sqlite::open(shelf.file());
    ASSERT_NO_THROW(other.exec("INSERT INTO audit VALUES(2, '', x'')"));  // the next number
  }
  JournalEntry command = entry("x");
  command.audit = R"({"x":1})";
  EXPECT_TRUE(shelf.journal(command));
  EXPECT_NE(shelf.store->set_aside(), "");
  command.result = "{1}";
  shelf.record(command);
  EXPECT_EQ(shelf.found("x")->result, "{1}");
  EXPECT_EQ(shelf.open().journal().unacknowledged().at(0).id, "x");
}

TEST_F(StoredJournalTest, JournalRemembersCommandsAndTheirFirstResult) {
  ASSERT_TRUE(shelf.store->journal().journal(std::vector{entry("one"), entry("two")}));
  shelf.record(entry("one", "{1}"));
  shelf.record(entry("one", "{2}"));
  shelf.record_acknowledged(entry("three", "{3}", kNow + 1));
  shelf.store->upkeep(kStart, kNow);
  shelf.open();
  const auto ids = shelf.store->journal().known_ids();
  ASSERT_EQ(ids.size(), 2U);
  EXPECT_EQ(ids[0].id, "one");
  EXPECT_EQ(ids[1].id, "three");
  EXPECT_EQ(ids[1].device, "a");
  EXPECT_EQ(ids[1].received_ms, kNow + 1);
  const auto open = shelf.store->journal().unacknowledged();
  ASSERT_EQ(open.size(), 2U);
  EXPECT_EQ(open[0].id, "one");
  EXPECT_EQ(open[0].result, "{1}");
  EXPECT_FALSE(open[0].acknowledged);
  EXPECT_EQ(open[1].result, "");
  EXPECT_EQ(open[1].response_topic, "hmi/replies");
  EXPECT_EQ(open[1].correlation, (Bytes{1, 0, 255}));
  EXPECT_EQ(open[1].deadline_ms, kNow + 10000);
  const auto three = shelf.found("three");
  ASSERT_TRUE(three);
  EXPECT_EQ(three->result, "{3}");
  EXPECT_TRUE(three->acknowledged);
  EXPECT_EQ(three->response_topic, "");  // no longer needed
  EXPECT_EQ(three->correlation, Bytes{});
}

TEST(StoredJournal, AcknowledgementsFollowResultsThatAreWrittenInParts) {
  ShelfWithoutDisk shelf;
  for (int i = 0; i < 1000; ++i) shelf.record_acknowledged(entry(std::to_string(i), "{}"));
  shelf.bring_disk();
  EXPECT_EQ(shelf.store->journal().known_ids().size(), 1000U);
  EXPECT_TRUE(shelf.store->journal().unacknowledged().empty());
}

TEST_F(StoredJournalTest, AcknowledgementIsOnDiskWithTheNextCommand) {
  shelf.record_acknowledged(entry("one", "{1}"));
  shelf.store->journal().note("delivered");
  ASSERT_TRUE(shelf.journal(entry("two")));
  const std::uint64_t records = shelf.store->audit().head().records;
  shelf.open();  // as after a kill: nothing has written the rest
  EXPECT_TRUE(shelf.found("one")->acknowledged);
  EXPECT_EQ(records, 1U);  // the audit has the delivery too
}

// The field forgets the oldest of 10,000 ids at once, the file once a minute.
TEST_F(StoredJournalTest, IdThatIsUsedAnewIsAnotherCommand) {
  JournalEntry first = entry("one");
  first.number = 7;
  JournalEntry again = entry("one", "", kNow + 60000);
  again.number = 8;
  again.op = "read";
  ASSERT_TRUE(shelf.journal(first));
  first.result = "{1}";
  shelf.record(first);
  shelf.store->upkeep(kStart, kNow);
  ASSERT_TRUE(shelf.journal(first));  // the same command
  EXPECT_EQ(shelf.found("one")->result, "{1}");
  ASSERT_TRUE(shelf.journal(again));
  const auto found = shelf.found("one");
  ASSERT_TRUE(found);
  EXPECT_EQ(found->result, "");
  EXPECT_FALSE(found->acknowledged);
  EXPECT_EQ(found->op, "read");
  EXPECT_EQ(found->received_ms, kNow + 60000);
  shelf.record(first);
  shelf.store->journal().acknowledge("a", "one", 7);  // a late one, for the first command
  shelf.store->upkeep(kStart + 1s, kNow);
  EXPECT_EQ(shelf.found("one")->result, "");
  again.result = "{2}";
  shelf.record(again);
  EXPECT_EQ(shelf.found("one")->result, "{2}");
  EXPECT_FALSE(shelf.found("one")->acknowledged);
  JournalEntry refused = entry("one", "{3}", kNow + 120000);  // it was never admitted
  refused.number = 9;
  shelf.record(refused);
  EXPECT_EQ(shelf.found("one")->result, "{3}");
  shelf.store->journal().acknowledge("a", "one", 9);
  shelf.store->upkeep(kStart + 2s, kNow);
  EXPECT_TRUE(shelf.found("one")->acknowledged);
}

TEST_F(StoredJournalTest, IdsAreForgottenAfterADayAndNotBeforeTheirDeadline) {
  const std::int64_t day = 24 * 3600 * 1000;
  // An hour longer than the field remembers ids, so that the field finds every id it asks for.
  for (const std::int64_t age : {day + 3620000, day + 3580000}) {
    const std::string id = std::to_string(age);
    shelf.record_acknowledged(entry(id, "{}", kNow - age));
  }
  JournalEntry late = entry("late", "{}", kNow - 2 * day);
  late.deadline_ms = kNow + 1;
  shelf.record_acknowledged(late);
  shelf.store->upkeep(kStart, kNow);
  const auto found = shelf.store->journal().known_ids();
  ASSERT_EQ(found.size(), 2U);
  EXPECT_EQ(found[0].id, "late");
  EXPECT_EQ(found[1].id, std::to_string(day + 3580000));
}

// The maximum age of samples neither shortens nor lengthens that of ids.
TEST(StoredJournal, IdsAreKeptForTheirDayHoweverLongSamplesAre) {
  for (const std::chrono::hours max_age : {1h, 1000h}) {
    Shelf shelf;
    shelf.config.max_age = max_age;
    shelf.open();
    for (const std::chrono::milliseconds age : {25h + 1s, 25h - 1s}) {
      const std::string id = std::to_string(age.count());
      shelf.record_acknowledged(entry(id, "{}", kNow - age.count()));
    }
    shelf.store->upkeep(kStart, kNow);
    const auto found = shelf.store->journal().known_ids();
    ASSERT_EQ(found.size(), 1U) << max_age.count();
    EXPECT_EQ(found[0].received_ms, kNow - std::chrono::milliseconds(25h - 1s).count());
  }
}

TEST_F(StoredJournalTest, OfTheOldestIdsTheResultsGoAndTheIdsStay) {
  for (std::size_t i = 0; i < kRememberedIds + 5; ++i) {
    const std::int64_t at = kNow - 100000 + static_cast<std::int64_t>(i);
    shelf.record_acknowledged(entry(std::to_string(i), "{}", at));
    if (i % 1000 == 0) shelf.store->upkeep(kStart + std::chrono::seconds(i), kNow - 200000);
  }
  shelf.store->upkeep(kStart + 10h, kNow);
  const auto found = shelf.store->journal().known_ids();
  EXPECT_EQ(found.size(), kRememberedIds + 5) << "every id is known";
  EXPECT_EQ(shelf.found("4")->result, "");
  EXPECT_EQ(shelf.found("5")->result, "{}");
}

TEST_F(StoredJournalTest, FaultInTheMiddleOfForgettingLeavesTheSizeRight) {
  JournalEntry old = entry("old", "{}", kNow - std::chrono::milliseconds(48h).count());
  shelf.record_acknowledged(old);
  for (std::size_t i = 0; i < kRememberedIds + 5; ++i) {
    shelf.record_acknowledged(entry(std::to_string(i), "{}"));
    if (i % 1000 == 0) shelf.store->upkeep(kStart + std::chrono::seconds(i), old.received_ms);
  }
  // No result is pending, and nothing is forgotten yet.
  shelf.store->upkeep(kStart + std::chrono::seconds(kRememberedIds + 1), old.received_ms);
  {
    // The first statement deletes "old"; the second one, on the results, fails.
    SQLite::Database other = sqlite::open(shelf.file());
    ASSERT_NO_THROW(
        other.exec("CREATE TRIGGER fault BEFORE UPDATE ON orders"
                   " BEGIN SELECT abs(-9223372036854775807 - 1); END"));
  }
  shelf.store->upkeep(kStart + 10h, kNow);
  ASSERT_EQ(shelf.store->state(), "memory");
  const std::uint64_t bytes = shelf.store->bytes();
  {
    SQLite::Database other = sqlite::open(shelf.file());
    ASSERT_NO_THROW(other.exec("DROP TRIGGER fault"));
  }
  EXPECT_EQ(shelf.open().bytes(), bytes);
  shelf.store->upkeep(kStart + 20h, kNow);
  EXPECT_FALSE(shelf.found("old"));
  EXPECT_LT(shelf.store->bytes(), bytes);
}

// Independently of the calendar, an id that came after 10,000 others is new, and an unacknowledged
// result is never skipped.
TEST_F(StoredJournalTest, NewestIdsAreThoseThatCameLast) {
  constexpr std::int64_t kHour = 3600000;
  for (std::size_t i = 0; i < kRememberedIds; ++i) {
    JournalEntry made = shelf.arrived(std::to_string(i), "{}", kNow + static_cast<std::int64_t>(i));
    shelf.record(made);
    if (i != 0) shelf.store->journal().acknowledge("a", made.id, made.number);
    if (i % 1000 == 0) shelf.store->upkeep(kStart + std::chrono::milliseconds(i), kNow);
  }
  for (const char* id : {"x", "y"}) {  // the clock was set back
    shelf.record_acknowledged(shelf.arrived(id, "{}", kNow - kHour));
  }
  shelf.store->upkeep(kStart + 20s, kNow + 20000);
  shelf.open(kNow + kHour);
  shelf.store->upkeep(kStart, kNow + kHour);
  const auto found = shelf.store->journal().known_ids();
  ASSERT_EQ(found.size(), kRememberedIds + 2);
  EXPECT_EQ(shelf.found("1")->result, "");
  EXPECT_EQ(shelf.found("2")->result, "{}");
  EXPECT_EQ(found.back().id, "y");
  ASSERT_EQ(shelf.store->journal().unacknowledged().size(), 1U);
  EXPECT_EQ(shelf.store->journal().unacknowledged()[0].id,
            "0");  // beyond the limit, but not acknowledged
}

TEST_F(StoredJournalTest, IdIsKeptUntilItsTimeIsOverHoweverManyFollow) {
  JournalEntry patient = entry("patient", "{}");
  patient.deadline_ms = kNow + 3600000;
  patient.number = shelf.store->audit().next_command_number();
  shelf.record_acknowledged(patient);
  shelf.store->upkeep(kStart, kNow);
  for (std::size_t i = 0; i < kRememberedIds; ++i) {
    shelf.record(shelf.arrived(std::to_string(i), "{}", kNow + 1000));
  }
  shelf.open(kNow + 1800000);
  shelf.store->upkeep(kStart, kNow + 1800000);
  EXPECT_EQ(shelf.store->journal().known_ids().front().id, "patient");
  EXPECT_EQ(shelf.store->journal().known_ids().size(), kRememberedIds + 1);
  shelf.open(kNow + 3600001);
  shelf.store->upkeep(kStart, kNow + 3600001);
  EXPECT_EQ(shelf.store->journal().known_ids().size(), kRememberedIds + 1);
  EXPECT_EQ(shelf.found("patient")->result, "");
}

TEST(StoredJournal, ResultsAboveTheShareOfCommandsGoAndTheIdsStay) {
  Shelf shelf;
  shelf.config.max_bytes = 1 << 20;
  shelf.open();
  for (int i = 0; i < 30; ++i) {
    shelf.record_acknowledged(shelf.arrived(std::to_string(i), std::string(60000, 'r')));
  }
  for (int i = 0; i < 5; ++i) shelf.store->upkeep(kStart + i * 1s, kNow + i * 1000);
  EXPECT_LE(shelf.store->bytes(), shelf.store->max_bytes() / 2);
  EXPECT_EQ(shelf.store->journal().known_ids().size(), 30U);
}

TEST_F(StoredJournalTest, CommandsThatWereRefusedDoNotFillTheFile) {
  for (std::size_t i = 0; i < 10500; ++i) {
    JournalEntry made = shelf.arrived(std::to_string(i), "{}");
    made.refused = true;
    shelf.record(made);
  }
  EXPECT_LE(shelf.store->journal().known_ids().size(), 10000U);
  EXPECT_FALSE(shelf.found("0"));
  EXPECT_TRUE(shelf.found("10499"));
  EXPECT_TRUE(shelf.store->journal().known_ids().front().refused);
}

TEST_F(StoredJournalTest, ResultsThatNobodyTakesDoNotFillTheDisk) {
  for (std::size_t i = 0; i < kRememberedIds + 3; ++i) {
    shelf.record(shelf.arrived(std::to_string(i), "{}"));
  }
  shelf.store->upkeep(kStart, kNow + 20000);
  EXPECT_FALSE(shelf.found("2"));
  EXPECT_TRUE(shelf.found("3"));
}

TEST(StoredJournal, ResultThatIsNotAcknowledgedIsKeptAsLongAsASample) {
  Shelf shelf;
  shelf.config.max_age = std::chrono::hours(48);
  shelf.open();
  const std::int64_t hour = 3600000;
  shelf.record(entry("older", "{}", kNow - 49 * hour));
  shelf.record(entry("old", "{}", kNow - 47 * hour));
  shelf.store->upkeep(kStart, kNow);
  const auto waiting = shelf.store->journal().unacknowledged();
  ASSERT_EQ(waiting.size(), 1U);
  EXPECT_EQ(waiting[0].id, "old");
}

// The result of the first one could not be written and the id was forgotten: a restart must know
// the command that is carried out now.
TEST_F(StoredJournalTest, CommandTakesThePlaceOfAnEarlierOneWithoutAResult) {
  JournalEntry command = shelf.arrived("x");
  ASSERT_TRUE(shelf.journal(command));
  JournalEntry anew = shelf.arrived("x");
  ASSERT_TRUE(shelf.journal(anew));
  command.result = "{1}";
  shelf.record(command);
  EXPECT_EQ(shelf.found("x")->number, anew.number);
  EXPECT_EQ(shelf.found("x")->result, "");
}

// The clock is set during a command: the result must not change the command's age.
TEST_F(StoredJournalTest, ResultLeavesTheTimeOfItsCommand) {
  JournalEntry command = shelf.arrived("x");
  ASSERT_TRUE(shelf.journal(command));
  command.result = "{}";
  command.received_ms = command.deadline_ms = 5000;
  shelf.record(command);
  EXPECT_EQ(shelf.found("x")->received_ms, kNow);
  EXPECT_EQ(shelf.found("x")->deadline_ms, kNow + 10000);
}

TEST(StoredJournal, ResultThatFoundNoDiskIsWrittenLater) {
  ShelfWithoutDisk shelf;
  shelf.record_acknowledged(entry("one", "{1}"));
  shelf.bring_disk();
  ASSERT_EQ(shelf.store->journal().known_ids().size(), 1U);
  EXPECT_EQ(shelf.found("one")->result, "{1}");
  EXPECT_TRUE(shelf.found("one")->acknowledged);
}

TEST(StoredJournal, CommandThatFoundNoDiskIsInTheJournalLater) {
  ShelfWithoutDisk shelf;
  const std::vector<JournalEntry> commands{entry("waits", ""), entry("done", "")};
  EXPECT_FALSE(shelf.store->journal().journal(commands));
  shelf.record(entry("done", "{1}"));
  shelf.record(entry("done", "{2}"));  // the first one stays, as in the file
  EXPECT_EQ(shelf.found("waits")->result, "");
  EXPECT_EQ(shelf.found("done")->result, "{1}");
  EXPECT_EQ(shelf.found("done")->deadline_ms, kNow + 10000);
  EXPECT_FALSE(shelf.found("never"));
  shelf.bring_disk();
  const auto found = shelf.store->journal().unacknowledged();
  ASSERT_EQ(found.size(), 2U);
  const bool done_first = found[0].id == "done";
  EXPECT_EQ(found[done_first ? 0 : 1].result, "{1}");
  EXPECT_EQ(found[done_first ? 1 : 0].id, "waits");
  EXPECT_EQ(found[done_first ? 1 : 0].result, "");
}

// The disk may be missing for a day: a command and its result use one place together, and a reused
// id takes its own place again.
TEST(StoredJournal, TenThousandCommandsFindRoomUntilThereIsADisk) {
  ShelfWithoutDisk shelf;
  const auto make = [](std::size_t i, std::uint64_t number) {
    JournalEntry made = entry(std::to_string(i), "");
    made.number = number;
    return made;
  };
  for (std::size_t i = 0; i < kRememberedIds; ++i) {
    JournalEntry made = make(i, 1 + i);
    EXPECT_FALSE(shelf.journal(made));
    made.result = "{" + std::to_string(i) + "}";
    shelf.record(std::move(made));
  }
  shelf.journal(make(7, 20000));  // reuses the id
  JournalEntry late = make(7, 8);
  late.result = "{late}";
  shelf.record(std::move(late));               // of the first command
  shelf.journal(make(kRememberedIds, 20001));  // one too many: drops the oldest
  EXPECT_EQ(shelf.found("7")->result, "");
  EXPECT_FALSE(shelf.found("0"));
  shelf.bring_disk();
  ASSERT_EQ(shelf.store->state(), "disk");
  EXPECT_EQ(shelf.store->journal().known_ids().size(), kRememberedIds - 2);
  EXPECT_EQ(shelf.store->journal().unacknowledged().back().id, std::to_string(kRememberedIds));
  EXPECT_EQ(shelf.found("9999")->result, "{9999}");
  EXPECT_EQ(shelf.found("7")->result, "");
  EXPECT_EQ(shelf.found("7")->number, 20000U);
}

}  // namespace
}  // namespace fxagent
