#include "agent/store/history.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace fxagent {
namespace {

TEST(HistoryText, HoldsRowsAsTheyWere) {
  EXPECT_EQ(fxagent::history_text(std::vector<std::string_view>{"{\"a\":1}", "{}"}),
            R"({"history":true,"rows":[{"a":1},{}]})");
  EXPECT_EQ(fxagent::history_text({}).size(), fxagent::kHistoryFrameBytes);
}

TEST(Row, IsIntactWhereItCanStandAmongOthers) {
  using namespace std::string_literals;
  EXPECT_TRUE(fxagent::is_intact(R"({"ts":1})"));
  for (const std::string& row : {""s, "{\"ts\":1"s, "{\"ts\":1}\0001}"s, "\xEF\xBB\xBF{}"s})
    EXPECT_FALSE(fxagent::is_intact(row)) << row;
}

}  // namespace
}  // namespace fxagent
