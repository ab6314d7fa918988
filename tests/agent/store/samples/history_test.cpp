#include "agent/store/samples/history.h"

#include <gtest/gtest.h>

#include "tests/agent/store/json_history.h"

namespace fxagent {
namespace {

using Added = BatchBuilder::Added;

TEST(Row, IsIntactWhereItCanStandAmongOthers) {
  using namespace std::string_literals;
  EXPECT_TRUE(fxagent::is_intact(R"({"ts":1})"));
  for (const std::string& row : {""s, "{\"ts\":1"s, "{\"ts\":1}\0001}"s, "\xEF\xBB\xBF{}"s})
    EXPECT_FALSE(fxagent::is_intact(row)) << row;
}

TEST(Row, FormatIsOneThatAProgramHasWritten) {
  EXPECT_EQ(row_format(0), RowFormat::json_text);
  EXPECT_EQ(row_format(1), RowFormat::cbor);
  for (const std::int64_t number : {std::int64_t{-1}, std::int64_t{2}, std::int64_t{256}})
    EXPECT_FALSE(row_format(number)) << number;
}

TEST(BatchBuilder, TakesRowsOfBothFormatsAndPassesOverDamagedOnes) {
  Telemetry message;
  message.seq = 7;
  const std::string row = encode_sample(message, DeviceConfig(), "9f3c21aa", "a41c");
  test::JsonHistory history(28);
  BatchBuilder builder(history);
  EXPECT_EQ(builder.add(1, RowFormat::cbor, row.substr(1)), Added::damaged);
  EXPECT_EQ(builder.add(2, RowFormat::json_text, "{"), Added::damaged);
  EXPECT_EQ(builder.add(3, std::nullopt, row), Added::damaged);
  EXPECT_TRUE(builder.empty());
  EXPECT_EQ(builder.add(4, RowFormat::cbor, row), Added::yes);
  EXPECT_EQ(builder.add(5, RowFormat::json_text, "[]"), Added::no_room);
  EXPECT_EQ(builder.add(6, RowFormat::json_text, "1"), Added::no_room);
  const HistoryBatch batch = builder.take({"a", "fast"});
  EXPECT_EQ(batch.row_ids, std::vector<std::uint64_t>{4});
  EXPECT_EQ(batch.payload, R"({"history":true,"rows":[7]})");
}

}  // namespace
}  // namespace fxagent
