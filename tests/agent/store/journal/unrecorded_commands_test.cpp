#include "agent/store/journal/unrecorded_commands.h"

#include <gtest/gtest.h>

namespace fxagent {
namespace {

JournalEntry entry(const std::string& id, std::uint64_t number, const std::string& result = {}) {
  JournalEntry made;
  made.device = "a";
  made.id = id;
  made.number = number;
  made.received_ms = 1000;
  made.deadline_ms = 2000;
  made.result = result;
  return made;
}

TEST(UnrecordedCommands, ResultTakesThePlaceOfItsCommandAndTheFirstOneStays) {
  UnrecordedCommands waiting;
  waiting.put(entry("x", 1));
  JournalEntry result = entry("x", 1, "{1}");
  result.deadline_ms = 500;
  waiting.put(result);
  waiting.put(entry("x", 1, "{2}"));
  ASSERT_EQ(waiting.size(), 1U);
  EXPECT_EQ(waiting.find("a", "x")->result, "{1}");
  EXPECT_EQ(waiting.find("a", "x")->deadline_ms, 2000) << "the later of the two";
  EXPECT_EQ(waiting.find("b", "x"), nullptr);
}

TEST(UnrecordedCommands, LaterCommandWithTheIdTakesThePlaceAndTheEarlierOnesResultIsLate) {
  UnrecordedCommands waiting;
  waiting.put(entry("x", 1, "{1}"));
  waiting.put(entry("x", 2));
  waiting.put(entry("x", 1, "{late}"));
  EXPECT_EQ(waiting.find("a", "x")->number, 2U);
  EXPECT_EQ(waiting.find("a", "x")->result, "");
}

TEST(UnrecordedCommands, OldestResultsMakeRoomBeforeAnyCommandDoes) {
  UnrecordedCommands waiting;
  waiting.put(entry("command", 1));
  for (std::size_t i = 0; i < UnrecordedCommands::kMost; ++i)
    waiting.put(entry(std::to_string(i), 2 + i, "{}"));
  EXPECT_EQ(waiting.size(), UnrecordedCommands::kMost);
  EXPECT_NE(waiting.find("a", "command"), nullptr);
  EXPECT_EQ(waiting.find("a", "0"), nullptr);
  EXPECT_NE(waiting.find("a", "1"), nullptr);
}

TEST(UnrecordedCommands, BytesAreBoundedTooAndRoomComesBackWithWhatIsDropped) {
  UnrecordedCommands waiting;
  const std::string large(UnrecordedCommands::kMostBytes / 3, 'x');
  for (std::uint64_t number = 1; number <= 3; ++number)
    waiting.put(entry(std::to_string(number), number, large));
  EXPECT_EQ(waiting.size(), 2U);
  waiting.drop_first(2);
  EXPECT_EQ(waiting.size(), 0U);
  for (std::uint64_t number = 4; number <= 5; ++number)
    waiting.put(entry(std::to_string(number), number, large));
  EXPECT_EQ(waiting.size(), 2U);
}

TEST(UnrecordedCommands, FirstOnesAreThoseThatLastChangedLongestAgo) {
  UnrecordedCommands waiting;
  waiting.put(entry("x", 1));
  waiting.put(entry("y", 2));
  waiting.put(entry("x", 1, "{1}"));
  EXPECT_EQ(waiting.begin()->id, "y");
  waiting.drop_first(1);
  EXPECT_EQ(waiting.find("a", "y"), nullptr);
  EXPECT_NE(waiting.find("a", "x"), nullptr);
}

TEST(UnrecordedCommands, TimesMoveWithTheCalendar) {
  UnrecordedCommands waiting;
  waiting.put(entry("x", 1));
  waiting.move_times(-300, 2, 1000);
  EXPECT_EQ(waiting.find("a", "x")->received_ms, 700);
  EXPECT_EQ(waiting.find("a", "x")->deadline_ms, 1700);
  waiting.move_times(-300, 1, 1000);
  EXPECT_EQ(waiting.find("a", "x")->received_ms, 400);
  waiting.move_times(-300, 2, 1000);
  EXPECT_EQ(waiting.find("a", "x")->received_ms, 400) << "of an earlier start of the machine";
}

}  // namespace
}  // namespace fxagent
