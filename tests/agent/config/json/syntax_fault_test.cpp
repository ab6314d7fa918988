#include "agent/config/json/syntax_fault.h"

#include <gtest/gtest.h>

#include <cstdio>
#include <initializer_list>
#include <nlohmann/json.hpp>

#include "agent/config/json/tree.h"
#include "tests/agent/config/small_plant.h"

namespace fxagent {
namespace {

using namespace test;

struct SyntaxCase {
  std::string_view text;
  std::string_view says;  ///< place, fault and cure
};

void expect_told(std::initializer_list<SyntaxCase> cases, Comments comments = Comments::refused) {
  for (const SyntaxCase& c : cases) {
    const auto tree = ConfigTree::parse(c.text, ConfigTree::Folding::tags, {}, comments);
    ASSERT_FALSE(tree) << c.text;
    EXPECT_NE(tree.error().text.find(c.says), std::string::npos) << tree.error().text;
  }
}

TEST(SyntaxFault, WhatPeopleGetWrongIsNamedWhereTheyWroteIt) {
  expect_told({
      SyntaxCase{"{\n  \"a\": 1, // the first\n  \"b\": 2\n}", "line 2, column 11: a comment"},
      SyntaxCase{"{\n  /* both */ \"a\": 1}", "line 2, column 3: a comment"},
      SyntaxCase{"# agent\n{}", "line 1, column 1: a comment"},
      SyntaxCase{"{\n  \"a\": 1\n  \"b\": 2}", "line 2, column 9: a comma is missing here"},
      SyntaxCase{"{\"a\": [1, 2]\n\n \"b\": 2}", "line 1, column 13: a comma is missing here"},
      SyntaxCase{"[{\"a\": 1}\n {\"a\": 2}]", "line 1, column 10: a comma is missing here"},
      SyntaxCase{"[\"a\"\n\"b\"]", "line 1, column 5: a comma is missing here"},
      SyntaxCase{"[true false]", "line 1, column 6: a comma is missing here"},
      SyntaxCase{"{\"a\": 1,\n}", "line 2, column 1: there is a comma before this }: remove"},
      SyntaxCase{"[1,]", "column 4: there is a comma before this ]: remove"},
      SyntaxCase{"[,1]", "column 2: there is nothing before this comma: remove"},
      SyntaxCase{"[1,,2]", "column 4: there is nothing before this comma: remove"},
      SyntaxCase{"{\"a\": , \"b\": 1}", "column 7: a value is missing before this comma"},
      SyntaxCase{"{\"a\": }", "column 7: a value is missing before this }"},
      SyntaxCase{"{\"a\"}", "column 5: a colon and a value are missing here"},
      SyntaxCase{"{\"a\", 1}", "column 5: a colon and a value are missing here"},
      SyntaxCase{"{\"a\" 1}", "column 5: a colon is missing here"},
      SyntaxCase{"{'a': 1}", "column 2: a single quote: JSON allows only double quotes (\")"},
      SyntaxCase{"{a: 1}", "column 2: the key has no quotes: write \"key\""},
      SyntaxCase{"{1: 1}", "column 2: a key needs double quotes"},
      SyntaxCase{"{\"a\": edge7}", "column 7: an unknown word. JSON has only"},
      SyntaxCase{"{\"a\": True}", "column 7: an unknown word. JSON has only"},
      SyntaxCase{"{\"devices\": [{\"tags\": [None]}]}",
                 "column 24: an unknown word. JSON has only"},
      SyntaxCase{"{\"a\" = 1}", "column 5: a colon is missing here"},
      SyntaxCase{"{}}", "column 3: more text after the end"},
      SyntaxCase{"{\"a\": \"b,\n \"c\": 1}",
                 "column 7: the string that begins here has no closing"},
      SyntaxCase{"{\"a\": \"b\\\"", "column 7: the string that begins here has no closing"},
      SyntaxCase{"{\"a\": [1, 2}", "column 12: a ] is missing before this }"},
      SyntaxCase{"[{\"a\": 1]", "column 9: a } is missing before this ]"},
      SyntaxCase{"{}\n{}", "line 2, column 1: more text after the end"},
      SyntaxCase{"\xEF\xBB\xBF{\"a\": 1,}", "there is a comma before this }"},
      SyntaxCase{"{\"a\": \"K\xFChler\"}", "column 9: the text is not UTF-8"},
      SyntaxCase{"{\"K\xFChler\": 1}", "column 4: the text is not UTF-8"},
      SyntaxCase{"{\"a\": \xFC}", "column 7: the text is not UTF-8"},
      SyntaxCase{"{\"a\": \"b\tc\"}", "column 9: a tab in a string: write \\t"},
      SyntaxCase{"[\"b\x01\"]", "column 4: a control character in a string: remove it"},
  });
}

TEST(SyntaxFault, FileWithoutContentIsCalledEmpty) {
  for (const char* text : {"", "\xEF\xBB\xBF", " \n\t\n", "// later\n"})
    expect_told({SyntaxCase{text, ": there is no value: the text is empty or has only comments"}},
                Comments::allowed);
}

TEST(SyntaxFault, WhatItDoesNotKnowKeepsTheParsersWords) {
  expect_told({
      SyntaxCase{"{\"a\": 01}", "column 9: "},  // read as 0, then another number
      SyntaxCase{"{\"a\": 1e999, // ten\n \"b\": 2}",
                 "overflow"},  // the rest of the line is not checked
      SyntaxCase{"[\"\\x\" // \n]", "column 4: "},
      SyntaxCase{"{\"a\": {", "unexpected end of input"},
  });
}

TEST(SyntaxFault, ABracketThatIsNotClosedHasItsLine) {
  expect_told({
      SyntaxCase{"{\n \"a\": [1,\n  2\n", "unexpected end of input"},
      SyntaxCase{"{\n \"a\": [1,\n  2\n", "; the [ in line 2 is not closed"},
      SyntaxCase{"{\n \"a\": 1", "line 2, column 7: "},
      SyntaxCase{"{\n \"a\": 1", "; the { in line 1 is not closed"},
      SyntaxCase{"[\n{\"a\": 1\n]",
                 "line 3, column 1: a } is missing before this ]; the { in line 2 is"},
      SyntaxCase{"{\"devices\": [\n{\"tags\": [\n{}\n}]}",
                 "line 4, column 1: a ] is missing before this }; the [ in line 2 is not closed"},
  });
}

TEST(SyntaxFault, MarksOfCommentsAreNamed) {
  expect_told(
      {
          SyntaxCase{"{\n} /* end",
                     "line 2, column 3: the comment that begins here has no closing */"},
          SyntaxCase{"# agent\n{}", "line 1, column 1: a comment begins with // and not with #"},
      },
      Comments::allowed);
}

/// Returns the byte of the place that an error names.
std::size_t named_byte(std::string_view text, const std::string& error) {
  int line = 0;
  int column = 0;
  EXPECT_EQ(std::sscanf(error.c_str(), "not JSON at line %d, column %d: ", &line, &column), 2);
  std::size_t start = 0;
  for (int i = 1; i < line; ++i) start = text.find('\n', start) + 1;
  return start + static_cast<std::size_t>(column) - 1;
}

// Changes one character at a time throughout a text: no mistake is placed behind the parser's
// place, and valid text is never called wrong.
TEST(SyntaxFault, IsNeverBehindTheParsersPlace) {
  using nlohmann::json;
  const std::string right = small_plant().dump(1);
  constexpr std::string_view spoilers = "{}[]:,\"'/#x0 \n\\";
  std::size_t named = 0;
  for (std::size_t at = 0; at < right.size(); at += 3)
    for (const char spoiler : spoilers) {
      std::string text = right;
      text[at] = spoiler;
      const auto tree = ConfigTree::parse(text);
      std::size_t byte = text.size();
      try {
        EXPECT_EQ(json::parse(text).is_discarded(), !tree);
      } catch (const json::parse_error& fault) {
        byte = fault.byte;
        EXPECT_FALSE(tree);
      } catch (const json::exception&) {
        EXPECT_FALSE(tree);
      }
      if (tree) continue;
      const std::string& error = tree.error().text;
      EXPECT_LE(named_byte(text, error), byte) << error << '\n' << text.substr(0, byte);
      if (error.find("syntax error") == std::string::npos) ++named;
    }
  EXPECT_GT(named, right.size() / 2) << "or this test looks at nothing";
}

}  // namespace
}  // namespace fxagent
