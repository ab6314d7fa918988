#include "agent/config/read/reader.h"
#include "agent/config/suggestions.h"

#include <gtest/gtest.h>

#include <array>

#include "tests/agent/config/small_plant.h"
#include "tests/support/says.h"

namespace fxagent {
namespace {

using namespace test;
using std::string_view_literals::operator""sv;
using Words = std::vector<std::string_view>;

TEST(NearestWords, OneLetterOffFindsTheWord) {
  constexpr std::array keys{"interval_ms"sv, "name"sv, "publish"sv, "max_silent_s"sv};
  EXPECT_EQ(nearest_words("intervall_ms", keys), Words{"interval_ms"});
  EXPECT_EQ(nearest_words("nmae", keys), Words{"name"});
  EXPECT_EQ(nearest_words("max_silent", keys), Words{"max_silent_s"});
}

TEST(NearestWords, BeginningOfSeveralMeansAllOfThem) {
  constexpr std::array keys{"username"sv, "password_file"sv, "password_env"sv, "passive"sv};
  EXPECT_EQ(nearest_words("password", keys), (Words{"password_file", "password_env"}));
}

TEST(NearestWords, EquallyNearOnesAreBothNamed) {
  constexpr std::array keys{"min"sv, "max"sv, "deadband"sv};
  EXPECT_EQ(nearest_words("mix", keys), (Words{"min", "max"}));
}

TEST(NearestWords, MeaningGoesBeforeLetters) {
  const auto parities = config_key("links[].serial.parity").limits.words;
  for (const auto& [said, meant] :
       {std::pair("E"sv, "even"sv), {"e", "even"}, {"N", "none"}, {"O", "odd"}, {"Even", "even"}})
    EXPECT_EQ(nearest_words(said, parities), Words{meant}) << said;
  const auto access = config_key("devices[].tags[].access").limits.words;
  for (const auto& [said, meant] : {std::pair("rw"sv, "read_write"sv),
                                    {"RW", "read_write"},
                                    {"readwrite", "read_write"},
                                    {"ro", "read"},
                                    {"r", "read"},
                                    {"readonly", "read"}})
    EXPECT_EQ(nearest_words(said, access), Words{meant}) << said;
  EXPECT_EQ(nearest_words("w", access), Words{"read_write"});
  EXPECT_EQ(nearest_words("slave", std::array{"name"sv, "station"sv}), Words{"station"});
  const auto protocols = protocol_key().limits.words;
  EXPECT_EQ(nearest_words("slmp", protocols), (Words{"mc-3e", "mc-4e"}));
  EXPECT_EQ(nearest_words("MELSEC", protocols), (Words{"mc-1e", "mc-3e"}));
  EXPECT_EQ(nearest_words("fx", protocols), (Words{"fx-programming-port", "fx-computer-link"}));
  const auto types = config_key("devices[].tags[].type").limits.words;
  EXPECT_EQ(nearest_words("short", types), Words{"int16"});
  EXPECT_EQ(nearest_words("long", types), Words{"int32"});
  EXPECT_EQ(nearest_words("text", types), Words{"string"});
  EXPECT_EQ(nearest_words("double", types), Words{"float64"});
  EXPECT_EQ(nearest_words("LREAL", types), Words{"float64"});
  EXPECT_EQ(nearest_words("qword", types), Words{"uint64"});
  EXPECT_EQ(nearest_words("lint", types), Words{"int64"});
  EXPECT_EQ(nearest_words("real", types), Words{"float32"});
  EXPECT_EQ(nearest_words("WORD", types), Words{"uint16"});
}

TEST(ConfigReader, KeyInTheWrongPlaceIsSentHome) {
  struct Case {
    std::string pointer;
    std::string value;
    std::string home;
  };
  for (const Case& c :
       {Case{"/groups", "[]", "it belongs inside devices[]"},
        Case{"/tags", "[]", "it belongs inside devices[]"},
        Case{"/servers", "[]", "it belongs inside mqtt"},
        Case{"/mqtt/store", "{}", "it belongs at the top level"},
        Case{"/mqtt/ca_file", R"("x")", "it belongs inside mqtt.tls"},
        Case{"/mqtt/port", "1883", "did you mean servers?"},
        Case{"/links/0/serial/port", R"("/dev/ttyUSB0")", "did you mean path?"},
        Case{"/links/0/baud", "9600", "it belongs inside links[].serial"},
        Case{"/devices/0/interval_ms", "5", "it belongs inside devices[].groups[]"},
        Case{"/devices/0/groups/0/tags", "[]", "it belongs inside devices[]"},
        Case{"/devices/0/tags/0/interval_ms", "5",
             "it belongs inside devices[].groups[], to the group that the tag names"},
        Case{"/devices/0/tags/0/intervall_ms", "5", "intervall_ms"},
        Case{"/devices/0/tags/0/link", R"("line1")", "it belongs inside devices[]"},
        Case{"/broker", R"("x")", "it is called servers and belongs inside mqtt"},
        Case{"/tag", "[]", "it is called tags and belongs inside devices[]"},
        Case{"/devices/0/tags/0/poll_ms", "5",
             "it is called interval_ms and belongs inside devices[].groups[], to the group that"},
        Case{"/devices/0/tags/0/interval", "5", "it is called interval_ms and belongs inside"},
        Case{"/devices/0/groups/0/interval", "5", "did you mean interval_ms?"},
        Case{"/devices/0/baud", "9600", "it belongs inside links[].serial"},
        Case{"/devices/0/baudrate", "9600", "it is called baud and belongs inside links[].serial"},
        Case{"/devices/0/host", R"("x")", "it belongs inside links[].tcp or links[].udp"},
        Case{"/links/0/groups", "[]", "it belongs inside devices[]"}})
    expect_refused(c.pointer, c.value, {"unknown key", c.home});
}

TEST(ConfigReader, SlaveIsNoUnitOfATag) {
  const auto errors = errors_of(changed("/devices/0/slave", "1"));
  ASSERT_EQ(errors.size(), 1U) << listed(errors);
  EXPECT_EQ(errors[0].text.find("tags"), std::string::npos) << errors[0].text;
}

TEST(NearestWords, NothingIsNearestToNothing) {
  EXPECT_TRUE(nearest_words("a", {}).empty());
  EXPECT_EQ(did_you_mean("a", {}), "");
}

TEST(NearestWords, AWordOfOtherLettersIsMeantByNobody) {
  constexpr std::array keys{"name"sv, "store"sv, "fast"sv};
  EXPECT_TRUE(nearest_words("baud", keys).empty());
  EXPECT_TRUE(nearest_words("broken", keys).empty());
  EXPECT_EQ(nearest_words("fats", keys), Words{"fast"});
  EXPECT_EQ(did_you_mean("baud", keys), "");
  EXPECT_EQ(did_you_mean("fats", keys), "; did you mean fast?");
}

TEST(NearestWords, VeryLongWordCostsNoTime) {
  constexpr std::array keys{"name"sv};
  EXPECT_TRUE(nearest_words(std::string(10000000, 'x'), keys).empty());
}

TEST(ConfigReader, EnvironmentFillsInAnyString) {
  const auto from = environment({{"HOST", "broker"}, {"LINE", "1"}, {"D", "100"}});
  auto plant = small_plant();
  plant["mqtt"]["servers"][0] = "mqtts://${HOST}:9${D}";
  plant["devices"][0]["link"] = "line${LINE}";
  plant["devices"][0]["tags"][0]["address"] = "D${D}";
  plant["devices"][0]["commands"]["allow"][0] = "M${D}-M${D}";
  const Config config = good(plant.dump(), from);
  EXPECT_EQ(config.mqtt.servers, std::vector<std::string>{"mqtts://broker:9100"});
  EXPECT_EQ(config.devices[0].link, 0U);
  EXPECT_EQ(config.devices[0].tags[0].point.address.text, "D100");
}

TEST(ConfigReader, MissingVariableIsNamed) {
  expect_refused("/mqtt/username", R"("a${FX_NO_SUCH}b")", {"FX_NO_SUCH", "not set"});
}

TEST(ConfigReader, DoubledDollarIsAPlainOne) {
  const auto from = environment({{"A", "x"}});
  EXPECT_EQ(good(changed("/mqtt/username", R"("$${A} ${A} $5 $$ ${A}$${")"), from).mqtt.username,
            "${A} x $5 $$ x${");
}

TEST(ConfigReader, VariableIsNotExpandedTwice) {
  const auto from = environment({{"A", "${B}"}});
  EXPECT_EQ(good(changed("/mqtt/username", R"("${A}")"), from).mqtt.username, "${B}");
}

TEST(ConfigReader, MalformedVariableIsAnError) {
  for (const auto* text : {R"("${")", R"("${}")", R"("${1A}")", R"("${A B}")", R"("${A")"})
    expect_refused("/mqtt/username", text, {"environment variable"});
}

TEST(ConfigReader, VariableThatIsEmptyLeavesAnEmptyString) {
  expect_error(errors_of(changed("/mqtt/username", R"("${A}")"), environment({{"A", ""}})),
               "/mqtt/username", {"empty", "${A}"});
}

TEST(ConfigReader, ErrorsShowTheVariableAndNeverItsValue) {
  const auto from = environment({{"SECRET", "hunter2"}});
  for (const auto* pointer :
       {"/agent/id", "/agent/root", "/mqtt/servers/0", "/mqtt/version", "/store/sync",
        "/links/0/name", "/links/1/tcp/host", "/devices/0/name", "/devices/0/link",
        "/devices/0/protocol", "/devices/0/model", "/devices/0/enquire",
        "/devices/0/tags/0/address", "/devices/0/tags/0/type", "/devices/0/tags/0/group",
        "/devices/0/tags/0/access", "/devices/0/commands/allow/0"}) {
    const auto errors = errors_of(changed(pointer, R"("${SECRET}+ #")"), from);
    ASSERT_FALSE(errors.empty()) << pointer;
    EXPECT_EQ(listed(errors).find("hunter2"), std::string::npos) << listed(errors);
    EXPECT_EQ(listed(errors).find("HUNTER2"), std::string::npos) << listed(errors);
  }
}

TEST(ConfigReader, ControlCharactersAreRefused) {
  expect_refused("/mqtt/username", R"("a\u0000b")", {"control"});
  expect_refused("/links/0/serial/path", R"("/dev/tty\n")", {"control"});
}

TEST(ConfigReader, WrongTypeSaysWhatIsWantedAndWhatWasFound) {
  struct Case {
    std::string pointer, value;
    std::vector<std::string> words;
  };
  for (const Case& c : std::vector<Case>{
           {"/mqtt/keep_alive_s", R"("30")", {"an integer from 1 to 65535", "the string \"30\""}},
           {"/mqtt/keep_alive_s", "30.5", {"integer", "30.5"}},
           {"/mqtt/keep_alive_s", "0", {"1 to 65535", "0"}},
           {"/mqtt/keep_alive_s", "65536", {"1 to 65535", "65536"}},
           {"/mqtt/keep_alive_s", "18446744073709551615", {"18446744073709551615"}},
           {"/mqtt/keep_alive_s", "1e300", {"integer", "the number"}},
           {"/mqtt/keep_alive_s", "null", {"null"}},
           {"/mqtt/username", "5", {"a string", "the number 5"}},
           {"/mqtt/username", "\"\"", {"empty"}},
           {"/mqtt/servers", R"("mqtt://a")", {"an array", "the string"}},
           {"/devices/0/tags/0", "[]", {"an object", "an array"}},
           {"/devices/0/echo", "1", {"true or false", "the number 1"}},
           {"/devices/0/tags/0/scale", "true", {"a number", "true"}},
           {"/devices/0/commands/allow", "{}", {"an array", "an object"}}}) {
    expect_refused(c.pointer, c.value, c.words);
  }
  // These errors cause further ones.
  expect_says(listed(errors_of(changed("/links/0", "7"))), "/links/0: must be an object");
  expect_says(listed(errors_of(changed("/agent", "[]"))), "/agent: must be an object");
}

TEST(ConfigReader, WholeNumberWithAPointIsAnInteger) {
  EXPECT_EQ(good(changed("/mqtt/keep_alive_s", "30.0")).mqtt.keep_alive.count(), 30);
  EXPECT_EQ(good(changed("/store/max_bytes", "1e9")).store.max_bytes, 1000000000U);
}

}  // namespace
}  // namespace fxagent
