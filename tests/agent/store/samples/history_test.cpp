#include "agent/store/samples/history.h"

#include <gtest/gtest.h>

#include "tests/agent/store/json_history.h"

namespace fxagent {
namespace {

using Added = BatchBuilder::Added;

TEST(BatchBuilder, TakesRowsUntilOneHasNoRoomAndPassesOverDamagedOnes) {
  test::JsonHistory history(28);
  BatchBuilder builder(history);
  const std::string row = test::row_content(7);
  for (const std::string& damaged : {std::string(), std::string("{}"), row.substr(1), row + "0"})
    EXPECT_EQ(builder.add(1, damaged), Added::damaged) << damaged;
  EXPECT_TRUE(builder.empty());
  EXPECT_EQ(builder.add(4, row), Added::yes);
  EXPECT_EQ(builder.add(5, row), Added::no_room);
  const HistoryBatch batch = builder.take({"a", "fast"});
  EXPECT_EQ(batch.row_ids, std::vector<std::uint64_t>{4});
  EXPECT_EQ(history.text(), R"({"history":true,"rows":[7]})");
}

}  // namespace
}  // namespace fxagent
