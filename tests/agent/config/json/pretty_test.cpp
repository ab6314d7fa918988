#include "agent/config/json/pretty.h"
#include "agent/config/json/tree.h"

#include <gtest/gtest.h>

namespace fxagent {
namespace {

TEST(PrettyText, WhatIsShortStaysOnALine) {
  EXPECT_EQ(pretty_text(R"({"a":[1,2],"b":{}})"), "{\"a\": [1, 2], \"b\": {}}\n");
}

TEST(PrettyText, WhatIsLongGetsALineForEachMember) {
  const std::string x(90, 'x');
  EXPECT_EQ(pretty_text(R"({"a":")" + x + R"(","b":[1,{"c":")" + x + R"("}]})"),
            "{\n  \"a\": \"" + x + "\",\n  \"b\": [\n    1,\n    {\n      \"c\": \"" + x +
                "\"\n    }\n  ]\n}\n");
}

TEST(PrettyText, NumbersAndTextStayAsTheyAre) {
  EXPECT_EQ(pretty_text(R"([0.10,1E5,-0,12345678901234567890,"\u00e4\"\n",null,true])"),
            "[0.10, 1E5, 0, 12345678901234567890, \"ä\\\"\\n\", null, true]\n");
}

TEST(PrettyText, DeepListsComeOutToo) {
  EXPECT_EQ(pretty_text(R"({"devices":[{"tags":[{"name":"t"}]}]})"),
            "{\"devices\": [{\"tags\": [{\"name\": \"t\"}]}]}\n");
}

TEST(PrettyText, MoreValuesThanATreeUsuallyHasComeOut) {
  std::string list = "[";
  for (std::size_t i = 0; i < TreeBounds::most_nodes; ++i) list += "0,";
  EXPECT_TRUE(pretty_text(list + "1]").ends_with("  0,\n  1\n]\n"));
}

TEST(PrettyText, WhatIsNoJsonIsEmpty) { EXPECT_EQ(pretty_text("{"), ""); }

}  // namespace
}  // namespace fxagent
