#include "agent/config/json/syntax_fault.h"

#include <gtest/gtest.h>

#include <initializer_list>
#include <string_view>

#include "agent/config/json/tree.h"
#include "tests/agent/config/small_plant.h"

namespace fxagent {
namespace {

using namespace test;

struct Case {
  std::string_view text;
  std::string_view says;  ///< place, fault and cure
};

void expect_told(std::initializer_list<Case> cases) {
  for (const Case& c : cases) {
    const auto tree = ConfigTree::parse(c.text);
    ASSERT_FALSE(tree) << c.text;
    EXPECT_NE(tree.error().text.find(c.says), std::string::npos) << tree.error().text;
  }
}

TEST(SyntaxFault, WhatPeopleGetWrongIsNamedWhereTheyWroteIt) {
  expect_told({
      Case{"{\n  \"a\": 1, // the first\n  \"b\": 2\n}", "line 2, column 11: a comment"},
      Case{"{\n  /* both */ \"a\": 1}", "line 2, column 3: a comment"},
      Case{"# agent\n{}", "line 1, column 1: a comment"},
      Case{"{\n  \"a\": 1\n  \"b\": 2}", "line 2, column 9: a comma is missing here"},
      Case{"{\"a\": [1, 2]\n\n \"b\": 2}", "line 1, column 13: a comma is missing here"},
      Case{"[{\"a\": 1}\n {\"a\": 2}]", "line 1, column 10: a comma is missing here"},
      Case{"[\"a\"\n\"b\"]", "line 1, column 5: a comma is missing here"},
      Case{"[true false]", "line 1, column 6: a comma is missing here"},
      Case{"{\"a\": 1,\n}", "line 2, column 1: there is a comma before this }: remove"},
      Case{"[1,]", "column 4: there is a comma before this ]: remove"},
      Case{"[,1]", "column 2: there is nothing before this comma: remove"},
      Case{"[1,,2]", "column 4: there is nothing before this comma: remove"},
      Case{"{\"a\": , \"b\": 1}", "column 7: a value is missing before this comma"},
      Case{"{\"a\": }", "column 7: a value is missing before this }"},
      Case{"{\"a\"}", "column 5: a colon and a value are missing here"},
      Case{"{\"a\", 1}", "column 5: a colon and a value are missing here"},
      Case{"{\"a\" 1}", "column 5: a colon is missing here"},
      Case{"{'a': 1}", "column 2: a single quote: JSON allows only double quotes (\")"},
      Case{"{a: 1}", "column 2: the key has no quotes: write \"key\""},
      Case{"{1: 1}", "column 2: a key needs double quotes"},
      Case{"{\"a\": edge7}", "column 7: an unknown word. JSON has only"},
      Case{"{\"a\": True}", "column 7: an unknown word. JSON has only"},
      Case{"{\"a\": \"b,\n \"c\": 1}", "column 7: the string that begins here has no closing"},
      Case{"{\"a\": [1, 2}", "column 12: a ] is missing before this }"},
      Case{"[{\"a\": 1]", "column 9: a } is missing before this ]"},
      Case{"{}\n{}", "line 2, column 1: more text after the end"},
      Case{"\xEF\xBB\xBF{\"a\": 1,}", "there is a comma before this }"},
  });
}

TEST(SyntaxFault, WhatItDoesNotKnowKeepsTheParsersWords) {
  expect_told({
      Case{"{\"a\": 01}", "column 9: "},                      // read as 0, then another number
      Case{"{\"a\": 1e999, // ten\n \"b\": 2}", "overflow"},  // the rest of the line is not checked
      Case{"[\"\\x\" // \n]", "column 4: "},
      Case{"{\"a\": {", "unexpected end of input"},
  });
}

// Changes one character at a time throughout a text: the fault is never placed after the parser's,
// and valid text is never called wrong.
TEST(SyntaxFault, IsNeverBehindTheParsersPlace) {
  const std::string right = small_plant().dump(1);
  EXPECT_FALSE(syntax_fault(right, right.size()));
  constexpr std::string_view spoilers = "{}[]:,\"'/#x0 \n\\";
  std::size_t named = 0;
  for (std::size_t at = 0; at < right.size(); at += 3)
    for (const char spoiler : spoilers) {
      std::string text = right;
      text[at] = spoiler;
      const auto tree = ConfigTree::parse(text);
      for (const std::size_t read : {at, text.size()}) {
        const auto fault = syntax_fault(text, read);
        if (fault) {
          EXPECT_LE(fault->at, read);
          EXPECT_FALSE(fault->text.empty());
        }
        if (tree) {
          EXPECT_FALSE(fault) << text.substr(at > 20 ? at - 20 : 0, 40) << '\n' << fault->text;
        } else if (fault) {
          ++named;
        }
      }
    }
  EXPECT_GT(named, right.size()) << "or this test looks at nothing";
}

}  // namespace
}  // namespace fxagent
