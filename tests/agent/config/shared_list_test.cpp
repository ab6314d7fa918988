#include "agent/config/shared_list.h"

#include <gtest/gtest.h>

namespace fxagent {
namespace {

TEST(SharedList, CopiesShareTheirElementsUntilOneIsChanged) {
  SharedList<std::string> one{"a", "b"};
  SharedList<std::string> other = one;
  EXPECT_TRUE(one.shares(other, 0));
  other[0] = "c";
  EXPECT_FALSE(one.shares(other, 0));
  EXPECT_TRUE(one.shares(other, 1)) << "what was not changed is shared still";
  EXPECT_EQ(std::as_const(one)[0], "a");
  EXPECT_EQ(std::as_const(other)[0], "c");
}

TEST(SharedList, ReadingSharesOn) {
  const SharedList<std::string> one{"a", "b"};
  const SharedList<std::string> other = one;
  std::string text;
  for (const std::string& each : other) text += each;
  EXPECT_EQ(text, "ab");
  EXPECT_TRUE(one.shares(other, 0));
}

TEST(SharedList, ReferencesOutliveTheListsThatGo) {
  auto one = std::make_unique<SharedList<std::string>>(SharedList<std::string>{"a"});
  const SharedList<std::string> other = *one;
  const std::string& element = std::as_const(*one)[0];
  one.reset();
  EXPECT_EQ(&element, &other[0]);
}

TEST(SharedList, LoopThatChangesMakesAllItsOwn) {
  SharedList<std::string> one{"a", "b"};
  const SharedList<std::string> other = one;
  for (std::string& each : one) each += "!";
  EXPECT_EQ(std::as_const(one)[1], "b!");
  EXPECT_EQ(other[1], "b");
}

TEST(SharedVector, CopiesShareAllUntilOneIsChanged) {
  SharedVector<std::string> one{"a", "b"};
  SharedVector<std::string> other = one;
  EXPECT_TRUE(one.shares(other));
  other[0] = "c";
  EXPECT_FALSE(one.shares(other));
  EXPECT_EQ(std::as_const(one)[0], "a");
  EXPECT_EQ(std::as_const(other)[0], "c");
  EXPECT_EQ(std::as_const(other)[1], "b");
}

TEST(SharedVector, ReadingSharesOn) {
  const SharedVector<std::string> one{"a", "b"};
  const SharedVector<std::string> other = one;
  std::string text;
  for (const std::string& each : other) text += each;
  EXPECT_EQ(text, "ab");
  EXPECT_EQ(&one[1], &other[1]);
}

TEST(SharedVector, ReferencesOutliveTheCopiesThatGo) {
  auto one = std::make_unique<SharedVector<std::string>>(SharedVector<std::string>{"a"});
  const SharedVector<std::string> other = *one;
  const std::string& element = std::as_const(*one)[0];
  one.reset();
  EXPECT_EQ(&element, &other[0]);
}

TEST(SharedVector, LoopThatChangesMakesAllItsOwn) {
  SharedVector<std::string> one{"a", "b"};
  const SharedVector<std::string> other = one;
  for (std::string& each : one) each += "!";
  one.push_back("c");
  EXPECT_EQ(one, (SharedVector<std::string>{"a!", "b!", "c"}));
  EXPECT_EQ(other, (SharedVector<std::string>{"a", "b"}));
}

TEST(SharedVector, OneWithoutElementsIsAnEmptyOne) {
  const SharedVector<std::string> none;
  EXPECT_TRUE(none.empty());
  EXPECT_EQ(none.begin(), none.end());
  EXPECT_EQ(none, SharedVector<std::string>({}));
}

}  // namespace
}  // namespace fxagent
