#include "protocol/value/short_text.h"

#include <gtest/gtest.h>

namespace fxagent {
namespace {

TEST(ShortText, HoldsWhatItWasGivenWhereverThatLies) {
  EXPECT_EQ(sizeof(ShortText), 16U);
  for (const std::size_t size : {0U, 1U, 14U, 15U, 16U, 17U, 300U}) {
    const std::string given(size, 'x');
    ShortText text = given;
    EXPECT_EQ(text, given);
    EXPECT_EQ(text.empty(), size == 0);
    const ShortText copy = text;
    const ShortText moved = std::move(text);
    EXPECT_EQ(copy, moved);
    EXPECT_EQ(moved, given);
    ShortText assigned = "a text of more than 15 characters";
    assigned = copy;
    EXPECT_EQ(assigned, given);
    EXPECT_EQ(copy, given);
    ShortText& same = assigned;
    assigned = same;
    EXPECT_EQ(assigned, given);
  }
}

TEST(ShortText, BytesOfAnyKindAreText) {
  const std::string odd("\0\x10\xFF", 3);
  EXPECT_EQ(ShortText(odd), odd);
  EXPECT_FALSE(ShortText(odd) == std::string_view("\0", 1));
  EXPECT_FALSE(ShortText("a") == ShortText("b"));
}

TEST(ShortText, JoinsLikeAString) {
  const ShortText name = "D100";
  EXPECT_EQ(name + " can only be read", "D100 can only be read");
  EXPECT_EQ("not " + (std::string("at ") + name), "not at D100");
}

TEST(ShortText, MovesWithAVectorThatGrows) {
  std::vector<ShortText> texts;
  for (int i = 0; i < 100; ++i) texts.push_back(std::string(static_cast<std::size_t>(i), 'y'));
  for (int i = 0; i < 100; ++i)
    EXPECT_EQ(texts[static_cast<std::size_t>(i)], std::string(static_cast<std::size_t>(i), 'y'));
}

}  // namespace
}  // namespace fxagent
