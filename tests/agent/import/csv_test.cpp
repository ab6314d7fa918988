#include "agent/import/csv.h"

#include <gtest/gtest.h>

namespace fxagent {
namespace {

std::vector<CsvRow> rows(std::string_view text) {
  auto list = read_csv(text);
  EXPECT_TRUE(list) << (list ? "" : list.error().text);
  return list ? *list : std::vector<CsvRow>{};
}

TEST(Csv, CellsAndLines) {
  const auto list = rows("a,b,c\r\n\r\n1,\"two, \"\"too\"\"\",3\n");
  ASSERT_EQ(list.size(), 2U);
  EXPECT_EQ(list[0].line, 1);
  EXPECT_EQ(list[1].line, 3);
  EXPECT_EQ(list[1].at(1), "two, \"too\"");
  EXPECT_EQ(list[1].at(7), "");
}

TEST(Csv, ARowThatGoesOverLinesHasTheLineOfItsBeginning) {
  const auto list = rows("a,\"b\nc\",d\ne,f\n");
  ASSERT_EQ(list.size(), 2U);
  EXPECT_EQ(list[0].line, 1);
  EXPECT_EQ(list[0].at(1), "b\nc");
  EXPECT_EQ(list[1].line, 3);
}

TEST(Csv, AnEmptyTextIsToldFromNothing) {
  const auto list = rows("a,,\"\"\n");
  ASSERT_EQ(list.at(0).cells.size(), 3U);
  EXPECT_FALSE(list[0].cells[1].has_value());
  EXPECT_EQ(list[0].cells[2], "");
}

TEST(Csv, TheLastLineNeedsNoEnd) { EXPECT_EQ(rows("a,b").at(0).at(1), "b"); }

TEST(Csv, BrokenQuotesAreTold) {
  const auto inside = read_csv("a,b\nc,\"d\"e\n");
  ASSERT_FALSE(inside);
  EXPECT_EQ(inside.error().line, 2);
  const auto open = read_csv("a,\"b\nc");
  ASSERT_FALSE(open);
  EXPECT_NE(open.error().text.find("ends inside quotes"), std::string::npos);
}

TEST(Csv, TheDelimiterIsWhatTheFileHasMostOf) {
  EXPECT_EQ(rows("a,b\nc,d\n").at(1).at(1), "d");
  EXPECT_EQ(rows("a\tb,c\td\n").at(0).at(1), "b,c");
  EXPECT_EQ(rows("a;b;c\n1,5;2;3\n").at(1).at(0), "1,5");
  EXPECT_TRUE(rows("").empty());
}

TEST(Csv, WhatStandsInQuotesOrInCommentsIsNoDelimiter) {
  const std::string comments = "a, b, c, d";
  EXPECT_EQ(rows("\"Device Name\"\t\"Comment\"\n\"D0\"\t\"a, b, c, d\"\n").at(1).at(1), comments);
  EXPECT_EQ(rows("Device Name\tComment\nD0\ta, b, c, d\nD1\te, f, g, h\n").at(1).at(1), comments);
  EXPECT_EQ(rows("Press 5, hall 2\nDevice Name\tComment\nD0\tspeed\n").at(2).at(1), "speed");
  EXPECT_EQ(rows("device;name\nd;a\n#device;\"{\"\"a\"\": 1, \"\"b\"\": 2,\n\"\"c\"\": 3}\"\n")
                .at(2)
                .at(1),
            "{\"a\": 1, \"b\": 2,\n\"c\": 3}");
  EXPECT_EQ(rows("Name,Text\nD0,a; b; c; d\n").at(1).at(1), "a; b; c; d");
  const auto pipe = read_csv("Name;Text\nD0; \"a, \"\"b\"\", c, d\"\nD1;5\" pipe\n");
  ASSERT_FALSE(pipe);
  EXPECT_EQ(pipe.error().line, 3);
  const auto early =
      read_csv("name;address;type\nt1;D1;int16\nt2;D2;int16;pipe,\"A\"\nt3;D3;a,b\nt4;D4;a,b\n");
  ASSERT_FALSE(early);
  EXPECT_EQ(early.error().line, 3) << "the rows behind the fault count, too";
}

TEST(Csv, CellsComeBackAsTheyWere) {
  for (const std::string text : {"", "a", " a ", "a,b", "\"", "a\nb", "x;y", "°C", "\t"}) {
    const auto list = rows("first," + csv_cell(text) + "\n");
    ASSERT_EQ(list.size(), 1U) << text;
    EXPECT_EQ(list[0].cells.at(1), text);
  }
  EXPECT_EQ(csv_cell(std::nullopt), "");
}

TEST(Csv, ColumnsAreFoundWhateverTheirCase) {
  const auto list = rows("Name, Address ,x\n");
  EXPECT_EQ(csv_column(list.at(0), "address"), 1U);
  EXPECT_EQ(csv_column(list.at(0), "name"), 0U);
  EXPECT_EQ(csv_column(list.at(0), "type"), std::string::npos);
}

}  // namespace
}  // namespace fxagent
