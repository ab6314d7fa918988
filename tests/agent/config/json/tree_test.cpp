#include "agent/config/json/tree.h"

#include <gtest/gtest.h>

#include "tests/support/says.h"

namespace fxagent {
namespace {

using Kind = ConfigNode::Kind;

ConfigTree parsed(std::string_view text) {
  auto tree = ConfigTree::parse(text);
  if (!tree) throw std::runtime_error(tree.error().text);
  return std::move(*tree);
}

TEST(ConfigTree, EveryValueKnowsItsLine) {
  const auto tree = parsed(
      "{\n"                   // 1
      "  \"a\": 1\n"          // 2: the lexer has read the newline after the number
      "  ,\"b\": -2.5,\n"     // 3
      "  \"c\": [\n"          // 4
      "    true, null,\n"     // 5
      "    {\"d\": \"x\"}\n"  // 6
      "  ],\r\n"              // 7
      "  \"e\":\n"            // 8
      "    {\n"               // 9
      "    }\n"               // 10
      "}");
  const auto line = [&](const ConfigNode& node) { return tree.line_of(node.offset); };
  const ConfigNode& root = tree.root();
  EXPECT_EQ(line(root), 1);
  EXPECT_EQ(line(*root.find("a")), 2);
  EXPECT_EQ(line(*root.find("b")), 3);
  const ConfigNode& c = *root.find("c");
  EXPECT_EQ(line(c), 4);
  EXPECT_EQ(line(c.children[0]), 5);
  EXPECT_EQ(line(c.children[1]), 5);
  EXPECT_EQ(line(c.children[2]), 6);
  EXPECT_EQ(line(*c.children[2].find("d")), 6);
  EXPECT_EQ(tree.line_of(root.find("e")->key_offset), 8);
  EXPECT_EQ(line(*root.find("e")), 9);
}

TEST(ConfigTree, NumberAtTheVeryEndIsInItsLine) {
  for (const std::string_view text : {"\n5", "\n5\n", "\n\t5 \n\n"}) {
    const auto tree = parsed(text);
    EXPECT_EQ(tree.line_of(tree.root().offset), 2) << text;
    EXPECT_EQ(tree.root().integer, 5);
  }
}

TEST(ConfigTree, PointerEscapesAndCounts) {
  const auto tree = parsed(R"({"a/b": [{"~c": 1}, {"é\n": 2}], "": {"": 3}})");
  const ConfigNode& list = *tree.root().find("a/b");
  EXPECT_EQ(pointer_to(tree.root()), "");
  EXPECT_EQ(pointer_to(list), "/a~1b");
  EXPECT_EQ(pointer_to(*list.children[0].find("~c")), "/a~1b/0/~0c");
  EXPECT_EQ(pointer_to(*list.children[1].find("é\n")), "/a~1b/1/é\\x0A");
  EXPECT_EQ(pointer_to(*tree.root().find("")->find("")), "//");
}

TEST(ConfigTree, PointersSurviveAMove) {
  auto tree = parsed(R"({"a": [1, 2]})");
  const ConfigTree moved = std::move(tree);
  EXPECT_EQ(pointer_to(moved.root().find("a")->children[1]), "/a/1");
}

TEST(ConfigTree, ArraysInItemsOfAnArrayAreReadWhenTheyAreAskedFor) {
  const auto tree = parsed(
      "{\"devices\": [{},\n"
      "  {\"tags\": [\n"                                     // 2
      "    {\"a\": [1, [\"]\"]]},\n"                         // 3
      "    \"x\", 2.5, null, true,\n"                        // 4
      "    7\n"                                              // 5: the lexer has read the newline
      "  ], \"groups\": [], \"more\": {\"allow\": [8]}},\n"  // 6
      "  {\"tags\": 5}]}");                                  // 7
  const auto& devices = tree.root().find("devices")->children;
  ASSERT_EQ(devices.size(), 3U);
  const ConfigNode& tags = *devices[1].find("tags");
  EXPECT_EQ(tags.kind, Kind::array);
  EXPECT_TRUE(tags.children.empty());
  EXPECT_EQ(tree.line_of(tags.offset), 2);
  EXPECT_TRUE(tree.items_of(*devices[1].find("groups")).empty());
  EXPECT_EQ(devices[1].find("more")->find("allow")->children.size(), 1U);
  EXPECT_EQ(devices[2].find("tags")->integer, 5);

  const auto items = tree.items_of(tags);
  ASSERT_EQ(items.size(), 6U);
  const ConfigNode& deep = items[0].find("a")->children[1].children[0];
  EXPECT_EQ(deep.text, "]");
  EXPECT_EQ(pointer_to(deep), "/devices/1/tags/0/a/1/0");
  EXPECT_EQ(tree.line_of(deep.offset), 3);
  EXPECT_EQ(tree.line_of(items[0].find("a")->key_offset), 3);
  EXPECT_EQ(items[1].text, "x");
  EXPECT_EQ(items[2].number, 2.5);
  EXPECT_EQ(items[3].kind, Kind::null);
  EXPECT_TRUE(items[4].boolean);
  EXPECT_EQ(items[5].integer, 7);
  EXPECT_EQ(tree.line_of(items[5].offset), 5);
  EXPECT_EQ(pointer_to(items[5]), "/devices/1/tags/5");
}

TEST(ConfigTree, FaultInAFoldedArrayIsFoundAtOnce) {
  const auto at_depth = [](std::string_view what) {
    return R"({"devices": [{"tags": [)" + std::string(what) + "]}]}";
  };
  for (const std::string_view fault : {"{]", "1 2", "tru", "1e999", "\"\xFF\""}) {
    const std::string text = at_depth(fault);
    EXPECT_FALSE(ConfigTree::parse(text)) << fault;
  }
  // The array is nested in four brackets.
  const std::string full = at_depth(std::string(28, '[') + std::string(28, ']'));
  EXPECT_TRUE(ConfigTree::parse(full));
  const std::string over = at_depth(std::string(29, '[') + std::string(29, ']'));
  test::expect_says(test::error_of(ConfigTree::parse(over)).text, "32 levels");
}

TEST(ConfigTree, ValuesKeepTheirKinds) {
  const auto tree = parsed(
      R"([null, false, -9223372036854775808, 9223372036854775808, 1e3, "a\u00e9\"", [], {}])");
  const auto& items = tree.root().children;
  ASSERT_EQ(items.size(), 8U);
  EXPECT_EQ(items[0].kind, Kind::null);
  EXPECT_EQ(items[1].kind, Kind::boolean);
  EXPECT_EQ(items[2].kind, Kind::integer);
  EXPECT_EQ(items[2].integer, std::numeric_limits<std::int64_t>::min());
  EXPECT_EQ(items[3].kind, Kind::number) << "past 63 bits";
  EXPECT_EQ(items[3].text, "9223372036854775808");
  EXPECT_EQ(items[4].kind, Kind::number);
  EXPECT_EQ(items[4].number, 1000.0);
  EXPECT_EQ(items[5].text, "aé\"");
  EXPECT_EQ(items[6].kind, Kind::array);
  EXPECT_EQ(items[7].kind, Kind::object);
}

TEST(ConfigTree, DuplicateKeysAreKeptInOrder) {
  const auto tree = parsed("{\"a\": 1,\n\"a\": 2}");
  ASSERT_EQ(tree.root().children.size(), 2U);
  EXPECT_EQ(tree.root().find("a")->integer, 1);
  EXPECT_EQ(tree.line_of(tree.root().children[1].key_offset), 2);
}

TEST(ConfigTree, SyntaxErrorNamesLineAndColumnInWords) {
  struct Case {
    std::string_view text;
    int line;
    std::string_view words;
  };
  for (const Case& c : {Case{"", 1, "line 1, column 1"},
                        {"{\n  \"a\": }\n", 2, "line 2, column 8"},
                        {"{\"a\": 1,}", 1, "line 1, column 9"},
                        {"[1, 2", 1, "line 1, column 5"},
                        {"{\"a\"", 1, "unexpected end of input; expected ':'"},
                        {"\n\n{} x", 3, "line 3, column 4"},
                        {"// no comments\n{}", 1, "line 1, column 1"},
                        {"{\"a\": 1e999}", 1, "number overflow"},
                        {"\"\xFF\"", 1, "UTF-8"},
                        {"\"a\nb\"", 1, "line 1"},
                        {"nan", 1, "line 1, column 1"}}) {
    const auto tree = ConfigTree::parse(c.text);
    ASSERT_FALSE(tree) << c.text;
    EXPECT_EQ(tree.error().line, c.line) << tree.error().text;
    EXPECT_NE(tree.error().text.find(c.words), std::string::npos) << tree.error().text;
    EXPECT_TRUE(tree.error().text.starts_with("not JSON at line ")) << tree.error().text;
    EXPECT_EQ(tree.error().text.find("json.exception"), std::string::npos) << tree.error().text;
  }
}

TEST(ConfigTree, ZeroByteDoesNotHideWhatFollows) {
  const auto error = test::error_of(ConfigTree::parse(std::string_view("{}\n\0garbage", 11)));
  EXPECT_EQ(error.line, 2);
  test::expect_says(error.text, "zero byte");
}

TEST(ConfigTree, Utf16IsNamed) {
  for (const std::string_view text :
       {std::string_view("\xFF\xFE{\0", 4), std::string_view("\xFE\xFF\0{", 4)}) {
    test::expect_says(test::error_of(ConfigTree::parse(text)).text, "UTF-16; save it as UTF-8");
  }
}

TEST(ConfigTree, BracketsWithoutEndDoNotFillTheStack) {
  test::expect_says(test::error_of(ConfigTree::parse(std::string(1000000, '['))).text, "32 levels");
  EXPECT_TRUE(ConfigTree::parse(std::string(32, '[') + std::string(32, ']')));
  EXPECT_FALSE(ConfigTree::parse(std::string(33, '[') + std::string(33, ']')));
}

TEST(ConfigTree, TextOverTheLimitIsRefused) {
  const std::string text(ConfigTree::max_bytes + 1, ' ');
  test::expect_says(test::error_of(ConfigTree::parse(text)).text, "64 MiB");
}

ConfigTree with_comments(std::string_view text) {
  auto tree = ConfigTree::parse(text, ConfigTree::Folding::tags, {}, Comments::allowed);
  if (!tree) throw std::runtime_error(tree.error().text);
  return std::move(*tree);
}

TEST(ConfigTree, CommentsAreSkippedAndMoveNoPlace) {
  const auto tree = with_comments(
      "// first, with \" and {\n"                   // 1
      "{ /* {\n"                                    // 2
      "  */ \"a\": 1, // one\r\n"                   // 3
      "  \"b\"/**/:/**/2/* two */\n"                // 4
      "  , \"url\": \"http://x/*y*/\", /*\n"        // 5
      " * / **/ \"devices\": [{\"tags\": [ // [\n"  // 6
      "    {}, /* ] */ 7 // seven\n"                // 7
      "    // , 8\n"                                // 8
      "    ,\"x\"]/**/}]} // end");                 // 9
  const ConfigNode& root = tree.root();
  const auto line = [&](const ConfigNode& node) { return tree.line_of(node.offset); };
  EXPECT_EQ(line(root), 2);
  EXPECT_EQ(line(*root.find("a")), 3);
  EXPECT_EQ(tree.line_of(root.find("b")->key_offset), 4);
  EXPECT_EQ(root.find("b")->integer, 2);
  EXPECT_EQ(root.find("url")->text, "http://x/*y*/");
  EXPECT_EQ(line(*root.find("devices")), 6);
  const auto items = tree.items_of(*root.find("devices")->children[0].find("tags"));
  ASSERT_EQ(items.size(), 3U);
  EXPECT_EQ(items[1].integer, 7);
  EXPECT_EQ(line(items[1]), 7);
  EXPECT_EQ(line(items[2]), 9);
}

TEST(ConfigTree, FaultBehindCommentsHasItsPlace) {
  struct Case {
    std::string_view text;
    std::string_view says;
  };
  for (const Case& c :
       {Case{"// one\n{\"a\": 1, /* two\n */ }",
             "line 3, column 5: there is a comma before this }"},
        {"{\"a\": 1 // one\n /* two */ \"b\": 2}", "line 1, column 8: a comma is missing here"},
        {"{\"a\" /* : */\n 1}", "line 1, column 5: a colon is missing here"},
        {"{} // end\n{}", "line 2, column 1: more text after the end"},
        {"{ // \"\n 'a': 1}", "line 2, column 2: a single quote"},
        {"{\"a\": \"b,\n // \"\n}", "line 1, column 7: the string that begins here has no closing"},
        {"{\"devices\": [{\"tags\": [1 // ,\n 2]}]}", "line 1, column 25: a comma is missing here"},
        {"{\"a\": 1}\n/", "line 2, column 1: "}}) {
    const auto tree = ConfigTree::parse(c.text, ConfigTree::Folding::tags, {}, Comments::allowed);
    ASSERT_FALSE(tree) << c.text;
    EXPECT_NE(tree.error().text.find(c.says), std::string::npos) << tree.error().text;
  }
}

TEST(ConfigTree, ByteOrderMarkIsSkipped) {
  EXPECT_EQ(parsed("\xEF\xBB\xBF{}").root().kind, Kind::object);
}

TEST(Shown, EscapesWhatATerminalMustNotSee) {
  EXPECT_EQ(shown("°C"), "°C");
  EXPECT_EQ(shown("a\x1b[31m\n"), "a\\x1B[31m\\x0A");
  EXPECT_EQ(shown("\xC3("), "\\xC3(");
  EXPECT_EQ(shown("\xF0\x9F\x98"), "\\xF0\\x9F\\x98");
}

TEST(Shown, CutsLongTextsBetweenCharacters) {
  EXPECT_EQ(shown(std::string(80, 'a')), std::string(80, 'a'));
  EXPECT_EQ(shown(std::string(81, 'a')), std::string(80, 'a') + "...");
  std::string wide(79, 'a');
  wide += "é";
  EXPECT_EQ(shown(wide), std::string(79, 'a') + "...");
}

}  // namespace
}  // namespace fxagent
