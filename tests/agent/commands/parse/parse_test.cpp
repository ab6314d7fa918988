#include "agent/commands/parse/parse.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "tests/agent/uplink/plant.h"
#include "tests/support/says.h"

namespace fxagent {
namespace {

using nlohmann::json;

TEST(ParseCommand, ReadsTheContractsExample) {
  const Command command = fxagent::parse_command(
      R"({"id": "b7e1", "op": "write", "tag": "setpoint", "value": 50, "expires": 1790000010000,
          "expect": 45, "verify": true, "dry_run": false, "by": "anna"})");
  EXPECT_FALSE(command.refusal) << command.refusal->detail;
  EXPECT_EQ(command.id, "b7e1");
  EXPECT_EQ(command.op, Op::write);
  EXPECT_EQ(command.op_text, "write");
  ASSERT_EQ(command.targets.size(), 1U);
  EXPECT_EQ(command.targets[0].tag, "setpoint");
  EXPECT_EQ(command.targets[0].value, Value(std::int64_t{50}));
  EXPECT_EQ(command.expires_ms, 1790000010000);
  EXPECT_EQ(command.expect, Value(std::int64_t{45}));
  EXPECT_EQ(command.verify, true);
  EXPECT_FALSE(command.dry_run);
  EXPECT_EQ(command.by, "anna");
}

TEST(ParseCommand, ReadsAnAddressWithType) {
  const Command command = fxagent::parse_command(
      R"({"id":"1","op":"write","address":"D7","type":"float32","value":[1.5,true,"x"]})");
  EXPECT_FALSE(command.refusal);
  EXPECT_EQ(command.targets.at(0).address, "D7");
  EXPECT_EQ(command.targets.at(0).type, DataType::float32);
  EXPECT_EQ(command.targets.at(0).value, Value::array({1.5, true, std::string("x")}));
}

TEST(ParseCommand, IntegersKeepAllTheirDigits) {
  const auto value_of = [](const std::string& value) {
    return parse_command(R"({"id":"1","op":"write","tag":"t","value":)" + value + "}")
        .targets.at(0)
        .value.value();
  };
  EXPECT_EQ(value_of("18446744073709551615"), Value(BigInteger{"18446744073709551615"}));
  EXPECT_EQ(value_of("9007199254740993"), Value(std::int64_t{9007199254740993}));
  EXPECT_EQ(value_of("\"9007199254740993\""), Value(std::string("9007199254740993")));
}

TEST(ParseCommand, ReadsTargets) {
  const Command command = fxagent::parse_command(
      R"({"id":"1","op":"write","targets":[{"tag":"a","value":1},{"address":"D1","value":[2]}]})");
  EXPECT_FALSE(command.refusal);
  EXPECT_TRUE(command.is_list);
  ASSERT_EQ(command.targets.size(), 2U);
  EXPECT_EQ(command.targets[1].address, "D1");
}

TEST(ParseCommand, NullIsAsGoodAsAbsent) {
  const std::vector<std::pair<std::string, std::string>> pairs{
      {R"({"id":"1","op":"write","tag":"a","value":1,"address":null,"type":null,"targets":null,
           "verify":null,"by":null,"expires":null,"dry_run":null,"count":null,"length":null})",
       R"({"id":"1","op":"write","tag":"a","value":1})"},
      {R"({"id":"1","op":"write","tag":null,"type":null,"targets":[
           {"tag":"a","address":null,"value":1},{"tag":null,"address":"D1","type":null,"value":2}]})",
       R"({"id":"1","op":"write","targets":[{"tag":"a","value":1},{"address":"D1","value":2}]})"},
      {R"({"id":"1","op":"run","tag":null,"address":null,"targets":null,"verify":null})",
       R"({"id":"1","op":"run"})"}};
  for (const auto& [with_nulls, without] : pairs) {
    const Command filled = fxagent::parse_command(with_nulls);
    const Command plain = fxagent::parse_command(without);
    ASSERT_FALSE(filled.refusal) << filled.refusal->detail;
    ASSERT_EQ(filled.targets.size(), plain.targets.size()) << without;
    for (std::size_t i = 0; i < plain.targets.size(); ++i) {
      EXPECT_EQ(filled.targets[i].tag, plain.targets[i].tag);
      EXPECT_EQ(filled.targets[i].address, plain.targets[i].address);
      EXPECT_EQ(filled.targets[i].type, plain.targets[i].type);
      EXPECT_EQ(filled.targets[i].value, plain.targets[i].value);
    }
    EXPECT_EQ(filled.is_list, plain.is_list);
    EXPECT_EQ(filled.expires_ms, plain.expires_ms);
    EXPECT_EQ(filled.verify, plain.verify);
    EXPECT_EQ(filled.dry_run, plain.dry_run);
  }
}

TEST(ParseCommand, NullIsNoConditionOrValueThatGotLost) {
  const std::vector<std::string> payloads{
      R"({"id":"1","op":"write","tag":"a","value":1,"expect":null})",
      R"({"id":"1","op":"write","tag":"a","value":null})",
      R"({"id":"1","op":"write","targets":[{"tag":"a","value":1},{"tag":"b","value":null}]})",
      R"({"id":"1","op":"force_on","address":"M1","expect":null})"};
  for (const std::string& payload : payloads) {
    const Command command = fxagent::parse_command(payload);
    ASSERT_TRUE(command.refusal) << payload;
    EXPECT_EQ(command.refusal->reason, Reason::bad_value) << payload;
    test::expect_says(command.refusal->detail, "null");
  }
}

// ---- keys by op ---------------------------------------------------------------------------------

struct ForeignKey {
  const char* payload;
  const char* key;
};

TEST(ParseCommand, KeyThatDoesNotGoWithTheOpIsNamed) {
  const std::vector<ForeignKey> table{
      {R"("op":"stop","expect":false)", "expect"},
      {R"("op":"stop","expect":null)", "expect"},
      {R"("op":"stop","tag":"nope")", "tag"},
      {R"("op":"stop","value":5)", "value"},
      {R"("op":"run","value":null)", "value"},
      {R"("op":"run","address":"D0")", "address"},
      {R"("op":"run","verify":true)", "verify"},
      {R"("op":"run","targets":[{"tag":"t"}])", "targets"},
      {R"("op":"read","tag":"t","expect":1)", "expect"},
      {R"("op":"read","tag":"t","value":1)", "value"},
      {R"("op":"read","tag":"t","verify":true)", "verify"},
      {R"("op":"read","targets":[{"tag":"t"}])", "targets"},
      {R"("op":"read","tag":"t","type":"int16")", "type"},
      {R"("op":"read","tag":"t","count":2)", "count"},
      {R"("op":"read","tag":"t","length":2)", "length"},
      {R"("op":"read","address":"D1","type":"string","count":2)", "count"},
      {R"("op":"read","address":"D1","length":2)", "length"},
      {R"("op":"read","address":"D1","type":"int16","length":2)", "length"},
      {R"("op":"write","address":"D1","value":1,"count":1)", "count"},
      {R"("op":"write","address":"D1","type":"string","value":"a","length":1)", "length"},
      {R"("op":"force_on","address":"M1","value":true)", "value"},
      {R"("op":"force_off","targets":[{"address":"M1","value":true}])", "value"},
      {R"("op":"force_off","targets":[{"address":"M1","value":null}])", "value"},
      {R"("op":"write","targets":[{"tag":"t","value":1}],"tag":"u")", "tag"},
      {R"("op":"write","targets":[{"tag":"t","value":1}],"value":1)", "value"},
      {R"("op":"write","targets":[{"tag":"t","value":1}],"value":null)", "value"},
      {R"("op":"write","targets":[{"tag":"t","value":1}],"expect":1)", "expect"},
      {R"("op":"write","targets":[{"tag":"t","value":1,"expect":1}])", "expect"},
      {R"("op":"write","targets":[{"tag":"t","type":"int16","value":1}])", "type"},
      {R"("op":"force_on","targets":[{"tag":"t"}],"expect":true)", "expect"}};
  for (const ForeignKey& row : table) {
    const Command command =
        fxagent::parse_command(R"({"id":"a",)" + std::string(row.payload) + "}");
    EXPECT_EQ(command.id, "a") << row.payload;
    ASSERT_TRUE(command.refusal) << row.payload;
    EXPECT_EQ(to_string(command.refusal->reason), "bad_json") << row.payload;
    EXPECT_NE(command.refusal->detail.find("'" + std::string(row.key) + "'"), std::string::npos)
        << row.payload << ": " << command.refusal->detail;
  }
}

TEST(ParseCommand, EveryKeyGoesWithItsOp) {
  const std::string all = R"(,"id":"a","expires":1790000010000,"by":"anna","dry_run":true})";
  for (const char* const payload :
       {R"({"op":"write","tag":"t","value":1,"expect":2,"verify":true)",
        R"({"op":"write","address":"D1","type":"int32","value":1,"expect":2,"verify":true)",
        R"({"op":"write","targets":[{"tag":"t","value":1}],"verify":true)",
        R"({"op":"force_on","address":"T5","type":"bool","expect":false,"verify":true)",
        R"({"op":"force_off","targets":[{"tag":"t"},{"address":"M1","type":"bool"}],"verify":true)",
        R"({"op":"read","tag":"t")", R"({"op":"read","address":"D1","type":"int32","count":125)",
        R"({"op":"read","address":"D1","type":"string","length":5)", R"({"op":"run")",
        R"({"op":"stop")"}) {
    const Command command = fxagent::parse_command(payload + all);
    EXPECT_FALSE(command.refusal) << payload << ": " << command.refusal.value_or(Refusal{}).detail;
  }
}

// For an unknown op the set of valid keys is unknown.
TEST(ParseCommand, UnknownOpIsNoQuestionOfItsKeys) {
  for (const char* const payload :
       {R"({"id":"a","op":"jump","tag":"t","targets":[{"tag":"t","value":1,"type":"int16"}]})",
        R"({"id":"a","op":"jump","expect":1,"count":7,"length":1})", R"({"id":"a","value":1})",
        R"({"id":"a","op":null,"value":null})"}) {
    const Command command = fxagent::parse_command(payload);
    ASSERT_TRUE(command.refusal) << payload;
    EXPECT_EQ(to_string(command.refusal->reason), "bad_op") << command.refusal->detail;
  }
  EXPECT_EQ(fxagent::parse_command(R"({"id":"a","op":"jump"})", "Run, Stop").refusal->detail,
            "op 'jump' is not one of Run, Stop");
  EXPECT_EQ(fxagent::parse_command(R"({"id":"a","op":"re-boot"})", "Run, Stop").refusal->detail,
            "op 're-boot' is not one of Run, Stop");
  EXPECT_TRUE(fxagent::parse_command(R"({"id":"a","op":"force-on"})")
                  .refusal->detail.ends_with(" (with _, not -)"));
  const Command unknown = fxagent::parse_command(R"({"id":"a","op":"jump","colour":1})");
  ASSERT_TRUE(unknown.refusal);
  EXPECT_EQ(unknown.refusal->reason, Reason::bad_json);
}

TEST(ParseCommand, ReadByAddressHasACountOrALength) {
  const auto target = [](const std::string& rest) {
    const Command command =
        fxagent::parse_command(R"({"id":"a","op":"read","address":"D1",)" + rest + "}");
    EXPECT_FALSE(command.refusal) << command.refusal.value_or(Refusal{}).detail;
    return command.targets.at(0);
  };
  EXPECT_EQ(target(R"("count":125)").count, 125);
  EXPECT_EQ(target(R"("type":"string","length":7)").count, 7);
  EXPECT_EQ(target(R"("type":"string","length":250)").count, 250);
  EXPECT_EQ(target(R"("count":null)").count, 0);
}

TEST(ParseCommand, ForcesAreListedWithoutValues) {
  const Command command = fxagent::parse_command(
      R"({"id":"1","op":"force_on","targets":[{"tag":"a"},{"address":"M1"}]})");
  ASSERT_FALSE(command.refusal) << command.refusal->detail;
  EXPECT_TRUE(command.is_list);
  ASSERT_EQ(command.targets.size(), 2U);
  EXPECT_FALSE(command.targets[1].value);
}

// ---- ids ----------------------------------------------------------------------------------------

TEST(ParseCommand, IntegerAsIdIsItsDecimalText) {
  for (const char* const id : {"7", "0", "-7", "9007199254740992", "-9007199254740992"}) {
    const Command command = fxagent::parse_command(R"({"op":"run","id":)" + std::string(id) + "}");
    EXPECT_FALSE(command.refusal) << id;
    EXPECT_EQ(command.id, id);
    EXPECT_TRUE(command.id_is_number);
  }
  EXPECT_FALSE(fxagent::parse_command(R"({"op":"run","id":"7"})").id_is_number);
}

TEST(ParseCommand, IntegerMayBeWrittenWithAZeroFraction) {
  const Command command =
      fxagent::parse_command(R"({"id":-7.0,"op":"read","address":"D1","count":2e0,"expires":5.0})");
  ASSERT_FALSE(command.refusal) << command.refusal->detail;
  EXPECT_EQ(command.id, "-7");
  EXPECT_TRUE(command.id_is_number);
  EXPECT_EQ(command.targets.at(0).count, 2);
  EXPECT_EQ(command.expires_ms, 5);
  EXPECT_EQ(parse_link_command(R"({"op":"yield","minutes":5.0})").time.count(), 5);
}

TEST(ParseCommand, NothingFollowsTheCommand) {
  const std::string order = R"({"id":"1","op":"run"})";
  for (const char* const more : {"", "{\"id\":\"2\",\"op\":\"stop\"}"}) {
    const Command command = fxagent::parse_command(order + '\0' + more);
    EXPECT_EQ(command.id, "1");
    ASSERT_TRUE(command.refusal);
    EXPECT_EQ(command.refusal->reason, Reason::bad_json);
    test::expect_says(command.refusal->detail, "NUL");
  }
}

TEST(ParseCommand, RunNeedsNoTarget) {
  const Command command = fxagent::parse_command(R"({"id":"1","op":"run"})");
  EXPECT_FALSE(command.refusal);
  EXPECT_TRUE(command.targets.empty());
}

struct Refused {
  const char* name;
  std::string payload;
  Reason reason;
  const char* detail_has;
  const char* id;
};

class CommandRefusal : public testing::TestWithParam<Refused> {};

TEST_P(CommandRefusal, IsTheFirstInTheOrderOfChecks) {
  const Command command = fxagent::parse_command(GetParam().payload);
  ASSERT_TRUE(command.refusal);
  EXPECT_EQ(to_string(command.refusal->reason), to_string(GetParam().reason));
  test::expect_says(command.refusal->detail, GetParam().detail_has);
  EXPECT_EQ(command.id, GetParam().id);
}

std::string write_with(const std::string& rest) {
  return R"({"id":"a","op":"write","tag":"t","value":1,)" + rest + "}";
}

INSTANTIATE_TEST_SUITE_P(
    Json, CommandRefusal,
    testing::Values(
        Refused{"TooLarge", std::string(65537, ' '), Reason::too_large, "65536", ""},
        Refused{"TooLargeWithAnId",
                R"({"by":[{"id":"no"}],"id":"b7e1","op":)" + std::string(65536, ' '),
                Reason::too_large, "65536", "b7e1"},
        Refused{"TooLargeWithItsIdInside", R"({"by":{"id":"no"},"op":)" + std::string(65536, ' '),
                Reason::too_large, "65536", ""},
        Refused{"TooLargeWithTwoIds", R"({"id":"x","id":"c","op":)" + std::string(65536, ' '),
                Reason::too_large, "65536", "x"},
        Refused{"TooLargeWithABadIdFirst", R"({"id":{},"id":"c","op":)" + std::string(65536, ' '),
                Reason::too_large, "65536", ""},
        Refused{"TooLargeWithABadId", R"({"id":true,"op":)" + std::string(65536, ' '),
                Reason::too_large, "65536", ""},
        Refused{"NoJson", "write 50", Reason::bad_json, "not JSON", ""},
        Refused{"MissingComma", "{\"id\":\"a\"\n\"op\":\"read\"}", Reason::bad_json, "comma", ""},
        Refused{"Empty", "", Reason::bad_json, "not JSON", ""},
        Refused{"Comment", R"({"id":"a"} // now)", Reason::bad_json, "a comment", ""},
        Refused{"Truncated", R"({"id":"a")", Reason::bad_json, "not JSON", ""},
        Refused{"Nan", R"({"id":"a","op":"write","tag":"t","value":NaN})", Reason::bad_json, "",
                ""},
        Refused{"TooLargeANumber", R"({"id":"a","value":1e999})", Reason::bad_json, "", ""},
        Refused{"BadUtf8", "{\"id\":\"\xFF\"}", Reason::bad_json, "", ""},
        Refused{"Array", "[1]", Reason::bad_json, "object", ""},
        Refused{"Deep", write_with(R"("expect":[[[[[1]]]]])"), Reason::bad_json, "deep", "a"},
        Refused{"DeeperThanAnyCommand",
                write_with(R"("by":)" + std::string(40, '[') + std::string(40, ']')),
                Reason::bad_json, "deep", "a"},
        Refused{"VeryDeep", std::string(60000, '['), Reason::bad_json, "", ""},
        Refused{"UnknownKey", write_with(R"("expirs":1)"), Reason::bad_json, "expires", "a"},
        Refused{
            "UnknownKeyInTargets",
            R"({"id":"a","op":"write","targets":[{"tag":"s","value":1},{"tag":"t","valeu":1}]})",
            Reason::bad_json, "target 2: unknown key 'valeu'; did you mean value?", "a"},
        Refused{"KeyTwice", R"({"id":"a","op":"write","tag":"t","value":1,"value":2})",
                Reason::bad_json, "twice", "a"},
        Refused{"NumberThatWouldBecome0", R"({"id":"a","op":"write","tag":"t","value":1e-400})",
                Reason::bad_json, "1e-400 is too close to 0", "a"},
        Refused{"NumberThatWouldBecome0InAnArray",
                R"({"id":"a","op":"write","tag":"t","value":[1,-0.1E-399]})", Reason::bad_json,
                "number -0.1E-399 is too close to 0", "a"},
        Refused{"Status", write_with(R"("status":"SUCCEEDED")"), Reason::bad_json, "status", "a"},
        Refused{"StatusOfAnyType", R"({"status":null})", Reason::bad_json, "status", ""},
        Refused{"NoId", R"({"op":"run"})", Reason::missing_id, "no id", ""},
        Refused{"FractionAsId", R"({"id":5.5,"op":"run"})", Reason::missing_id, "integer", ""},
        Refused{"HugeId", R"({"id":9007199254740993,"op":"run"})", Reason::missing_id, "2^53", ""},
        Refused{"HugeNegativeId", R"({"id":-9007199254740993,"op":"run"})", Reason::missing_id,
                "2^53", ""},
        Refused{"HugestId", R"({"id":18446744073709551615,"op":"run"})", Reason::missing_id, "2^53",
                ""},
        Refused{"BoolAsId", R"({"id":true,"op":"run"})", Reason::missing_id, "string", ""},
        Refused{"EmptyId", R"({"id":"","op":"run"})", Reason::missing_id, "1 to 64", ""},
        Refused{"LongId", R"({"op":"run","id":")" + std::string(65, 'x') + "\"}",
                Reason::missing_id, "1 to 64", ""},
        Refused{"IdWithControl", R"({"id":"a\u0007","op":"run"})", Reason::missing_id, "ASCII", ""},
        Refused{"IdNotAscii", R"({"id":"ä","op":"run"})", Reason::missing_id, "ASCII", ""},
        Refused{"NullAsId", R"({"id":null,"op":"run"})", Reason::missing_id, "no id", ""},
        Refused{"NoOp", R"({"id":"a","tag":"t"})", Reason::bad_op, "no op", "a"},
        Refused{"NullAsOp", R"({"id":"a","op":null,"tag":"t"})", Reason::bad_op, "no op", "a"},
        Refused{"NullAsTarget", R"({"id":"a","op":"read","tag":null})", Reason::unknown_tag,
                "neither", "a"},
        Refused{"NullInAnArray", R"({"id":"a","op":"write","tag":"t","value":[1,null]})",
                Reason::bad_value, "element 2 of value is null, as NaN is in JSON", "a"},
        Refused{"ListInAList", R"({"id":"a","op":"write","tag":"t","value":[[1]]})",
                Reason::bad_value, "element 1 of value", "a"},
        Refused{"NullOfAnUnknownKey", write_with(R"("expirs":null)"), Reason::bad_json, "expires",
                "a"},
        Refused{"UnknownOp", R"({"id":"a","op":"Write","tag":"t"})", Reason::bad_op, "'Write'",
                "a"},
        Refused{"NumberAsOp", R"({"id":"a","op":1,"tag":"t"})", Reason::bad_op, "string", "a"},
        Refused{"NoTarget", R"({"id":"a","op":"read"})", Reason::unknown_tag, "neither", "a"},
        Refused{"NumberAsTag", R"({"id":"a","op":"read","tag":1})", Reason::unknown_tag, "tag",
                "a"},
        Refused{"NumberAsAddress", R"({"id":"a","op":"read","address":100})", Reason::bad_address,
                "address", "a"},
        Refused{"TagAndAddress", R"({"id":"a","op":"read","tag":"t","address":"D1"})",
                Reason::bad_address, "cannot be used together", "a"},
        Refused{"TargetsAndTag", R"({"id":"a","op":"write","tag":"t","targets":[{"tag":"t"}]})",
                Reason::bad_json, "together with targets: set it in each target", "a"},
        Refused{"TargetsAndExpect",
                R"({"id":"a","op":"write","expect":1,"targets":[{"tag":"t","value":1}]})",
                Reason::bad_json, "together with targets: send a command with one tag", "a"},
        Refused{"ExpectInATarget",
                R"({"id":"a","op":"write","targets":[{"tag":"t","value":1,"expect":1}]})",
                Reason::bad_json, "'expect' is not a key of a target: it needs a command without",
                "a"},
        Refused{"NoCount", R"({"id":"a","op":"read","address":"D1","count":0})", Reason::bad_value,
                "1 to 125", "a"},
        Refused{"LargeCount", R"({"id":"a","op":"read","address":"D1","count":126})",
                Reason::bad_value, "1 to 125", "a"},
        Refused{"TextAsCount", R"({"id":"a","op":"read","address":"D1","count":"2"})",
                Reason::bad_value, "1 to 125", "a"},
        Refused{"LargeLength",
                R"({"id":"a","op":"read","address":"D1","type":"string","length":251})",
                Reason::bad_value, "1 to 250", "a"},
        Refused{"NoTargets", R"({"id":"a","op":"write","targets":[]})", Reason::bad_address,
                "at least one", "a"},
        Refused{"TargetsOfNumbers", R"({"id":"a","op":"write","targets":[1]})", Reason::bad_address,
                "object", "a"},
        Refused{"UnknownType", R"({"id":"a","op":"read","address":"D1","type":"whatever"})",
                Reason::bad_value, "whatever", "a"},
        Refused{"NumberAsType", R"({"id":"a","op":"read","address":"D1","type":1})",
                Reason::bad_value, "type", "a"},
        Refused{"ObjectAsValue", R"({"id":"a","op":"write","tag":"t","value":{}})",
                Reason::bad_value, "value", "a"},
        Refused{"TextAsExpires", write_with(R"("expires":"soon")"), Reason::bad_value, "expires",
                "a"},
        Refused{"NegativeExpires", write_with(R"("expires":-1)"), Reason::bad_value, "expires",
                "a"},
        Refused{"FractionAsExpires", write_with(R"("expires":1790000000000.5)"), Reason::bad_value,
                "whole number", "a"},
        Refused{"HugeExpires", write_with(R"("expires":1e300)"), Reason::bad_value, "expires", "a"},
        Refused{"NullAsExpect", write_with(R"("expect":null)"), Reason::bad_value, "expect", "a"},
        Refused{"TextAsVerify", write_with(R"("verify":"no")"), Reason::bad_value, "verify", "a"},
        Refused{"TextAsDryRun", write_with(R"("dry_run":"true")"), Reason::bad_value, "dry_run",
                "a"},
        Refused{"NumberAsBy", write_with(R"("by":7)"), Reason::bad_value, "by", "a"},
        Refused{"JsonBeforeId", R"({"id":5.5,"colour":1})", Reason::bad_json, "colour", ""},
        Refused{"OpBeforeValue", R"({"id":"a","op":"x","tag":"t","verify":1})", Reason::bad_op, "",
                "a"},
        Refused{"TargetBeforeValue", R"({"id":"a","op":"write","verify":1,"value":1})",
                Reason::unknown_tag, "", "a"}),
    [](const auto& refused) { return refused.param.name; });

TEST(ParseCommand, ExpiresMayBeWrittenAsAFloatThatIsWhole) {
  const Command command = fxagent::parse_command(write_with(R"("expires":1.79e12)"));
  EXPECT_FALSE(command.refusal);
  EXPECT_EQ(command.expires_ms, 1790000000000);
}

TEST(ParseCommand, BracketsInATextAreNoDepth) {
  const std::string brackets(2000, '[');
  for (const std::string& by : {brackets, R"(\")" + brackets})
    EXPECT_FALSE(fxagent::parse_command(write_with(R"("by":")" + by + "\"")).refusal);
}

TEST(ParseCommand, MoreThanSixtyFourTargetsAreTooLargeAndNoneOfThemIsKept) {
  const auto with = [](int count) {
    std::string targets;
    for (int i = 0; i < count; ++i) targets += (i == 0 ? "" : ",") + std::string(R"({"tag":"a"})");
    return fxagent::parse_command(R"({"id":"b7e1","op":"write","targets":[)" + targets + "]}");
  };
  EXPECT_FALSE(with(64).refusal && with(64).refusal->reason == Reason::too_large);
  const Command many = with(65);
  ASSERT_TRUE(many.refusal);
  EXPECT_EQ(many.refusal->reason, Reason::too_large);
  EXPECT_EQ(many.id, "b7e1");
  EXPECT_TRUE(many.targets.empty());
  std::string empty = "{}";
  while (empty.size() < 63000) empty += ",{}";
  const Command hostile =
      fxagent::parse_command(R"({"id":"x","op":"write","targets":[)" + empty + "]}");
  EXPECT_TRUE(hostile.targets.empty());
}

TEST(ParseCommand, PlaceThatNobodyCanMeanIsCutOff) {
  const Command parsed = fxagent::parse_command(R"({"id":"b7e1","op":"read","tag":")" +
                                                std::string(60000, 'a') + R"("})");
  EXPECT_LE(parsed.targets.at(0).tag.size(), 128U);
}

// ---- commands for a link ------------------------------------------------------------------------

TEST(ParseLinkCommand, YieldAndResume) {
  const LinkCommand yield =
      parse_link_command(R"({"id":"y","op":"yield","minutes":720,"by":"anna","expires":5})");
  EXPECT_FALSE(yield.command.refusal);
  EXPECT_EQ(yield.command.id, "y");
  EXPECT_EQ(yield.command.op_text, "yield");
  EXPECT_EQ(yield.command.by, "anna");
  EXPECT_EQ(yield.command.expires_ms, 5);
  EXPECT_EQ(yield.time.count(), 720);
  EXPECT_EQ(parse_link_command(R"({"op":"yield"})").time.count(), 15);
  EXPECT_EQ(parse_link_command(R"({"op":"yield","minutes":null})").time.count(), 15);
  const LinkCommand resume = parse_link_command(R"({"op":"resume"})");
  EXPECT_FALSE(resume.command.refusal);
  EXPECT_EQ(resume.time.count(), 0);
}

TEST(ParseLinkCommand, FirstFaultIsNamed) {
  const std::vector<std::pair<std::string, Reason>> cases{
      {"", Reason::bad_json},
      {"[]", Reason::bad_json},
      {R"({"op":"yield","op":"resume"})", Reason::bad_json},
      {R"({"op":"yield","value":1})", Reason::bad_json},
      {R"({"op":"resume","minutes":1})", Reason::bad_json},
      {R"({"op":"yield","id":""})", Reason::missing_id},
      {R"({"op":"write"})", Reason::bad_op},
      {R"({"op":"read","tag":"temp"})", Reason::bad_json},
      {R"({"op":7})", Reason::bad_op},
      {"{}", Reason::bad_op},
      {R"({"op":"yield","minutes":0})", Reason::out_of_range},
      {R"({"op":"yield","minutes":721})", Reason::out_of_range},
      {R"({"op":"yield","minutes":18446744073709551615})", Reason::out_of_range},
      {R"({"op":"yield","minutes":-1})", Reason::out_of_range},
      {R"({"op":"yield","minutes":1e300})", Reason::out_of_range},
      {R"({"op":"yield","minutes":1.5})", Reason::out_of_range},
      {R"({"op":"yield","minutes":true})", Reason::bad_value},
      {R"({"op":"yield","minutes":"5"})", Reason::bad_value},
      {std::string(65537, ' '), Reason::too_large},
  };
  for (const auto& [text, reason] : cases) {
    const LinkCommand parsed = parse_link_command(text);
    ASSERT_TRUE(parsed.command.refusal) << text.substr(0, 60);
    EXPECT_EQ(parsed.command.refusal->reason, reason) << text.substr(0, 60);
    EXPECT_FALSE(parsed.command.refusal->detail.empty());
  }
}

}  // namespace
}  // namespace fxagent
