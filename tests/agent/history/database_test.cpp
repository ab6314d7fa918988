// Cures of failed statements, and connection strings.
#include "agent/history/database.h"

#include <gtest/gtest.h>

namespace fxagent::history {
namespace {

TEST(HistoryDatabase, CureFitsTheSqlstate) {
  EXPECT_TRUE(cure_of("").starts_with("not reachable"));
  EXPECT_TRUE(cure_of("57P01").starts_with("not reachable"));
  EXPECT_NE(cure_of("42501").find("GRANT fxhistory_writer"), std::string::npos);
  EXPECT_NE(cure_of("3F000").find("schema.sql"), std::string::npos);
  EXPECT_NE(cure_of("42P01").find("schema.sql"), std::string::npos);
  EXPECT_NE(cure_of("42883").find("schema.sql"), std::string::npos);
  EXPECT_EQ(cure_of("53100"), "see the log of the database");
}

TEST(HistoryDatabase, ConnectionStringThatLibpqCannotParseIsAFault) {
  EXPECT_EQ(fault_of_target("host=/run/postgresql dbname=history"), "");
  EXPECT_EQ(fault_of_target("postgresql://localhost/history"), "");
  EXPECT_EQ(fault_of_target("history"), "");
  EXPECT_EQ(fault_of_target(""), "may not be empty");
  EXPECT_NE(fault_of_target("host=a history"), "");
  EXPECT_NE(fault_of_target("no_such_option=1"), "");
  EXPECT_NE(fault_of_target("postgresql://[::1/"), "");
}

}  // namespace
}  // namespace fxagent::history
