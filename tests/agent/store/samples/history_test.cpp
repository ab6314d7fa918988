#include "agent/store/samples/history.h"

#include <gtest/gtest.h>

#include "tests/agent/store/json_history.h"

namespace fxagent {
namespace {

using Added = BatchBuilder::Added;

TEST(BatchBuilder, PassesOverJsonThatCannotStandAmongOthers) {
  using namespace std::string_literals;
  test::JsonHistory history(28);
  BatchBuilder builder(history);
  for (const std::string& row : {""s, "{\"ts\":1"s, "{\"ts\":1}\0001}"s, "\xEF\xBB\xBF{}"s})
    EXPECT_EQ(builder.add(1, RowFormat::json_text, row), Added::damaged) << row;
  EXPECT_EQ(builder.add(1, RowFormat::json_text, R"({"ts":1})"), Added::yes);
}

TEST(BatchBuilder, PassesOverFormatsThatNoProgramHasWritten) {
  const std::string row = encode_sample(Telemetry(), DeviceConfig(), "9f3c21aa", "a41c");
  test::JsonHistory history(28);
  BatchBuilder builder(history);
  for (const std::int64_t number : {std::int64_t{-1}, std::int64_t{2}, std::int64_t{256}})
    for (const std::string& content : {row, std::string("1")})
      EXPECT_EQ(builder.add(1, static_cast<RowFormat>(number), content), Added::damaged) << number;
}

TEST(BatchBuilder, TakesRowsOfBothFormatsAndPassesOverDamagedOnes) {
  Telemetry message;
  message.seq = 7;
  const std::string row = encode_sample(message, DeviceConfig(), "9f3c21aa", "a41c");
  test::JsonHistory history(28);
  BatchBuilder builder(history);
  EXPECT_EQ(builder.add(1, RowFormat::cbor, row.substr(1)), Added::damaged);
  EXPECT_EQ(builder.add(2, RowFormat::json_text, "{"), Added::damaged);
  EXPECT_TRUE(builder.empty());
  EXPECT_EQ(builder.add(4, RowFormat::cbor, row), Added::yes);
  EXPECT_EQ(builder.add(5, RowFormat::json_text, "[]"), Added::no_room);
  EXPECT_EQ(builder.add(6, RowFormat::json_text, "1"), Added::no_room);
  const HistoryBatch batch = builder.take({"a", "fast"});
  EXPECT_EQ(batch.row_ids, std::vector<std::uint64_t>{4});
  EXPECT_EQ(history.text(), R"({"history":true,"rows":[7]})");
}

}  // namespace
}  // namespace fxagent
