// Compares docs/interface.md, which users build on, with the program: examples, words, numbers.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <nlohmann/json.hpp>

#include "agent/commands/journal.h"
#include "agent/commands/parse/parse.h"
#include "agent/commands/result.h"
#include "agent/config/read/config_limits.h"
#include "agent/handover/command_message.h"
#include "agent/handover/telemetry.h"
#include "agent/remote/remote_config.h"
#include "agent/store/samples/history.h"
#include "agent/uplink/broker.h"
#include "agent/uplink/payload/json_payload.h"
#include "tests/agent/uplink/plant.h"
#include "tests/agent/uplink/sample_text.h"
#include "tests/support/scratch.h"

namespace fxagent {
namespace {

using nlohmann::json;
using namespace std::chrono_literals;

constexpr const char* kBoot = "9f3c21aa";
constexpr const char* kMeta = "a41c0f5b7d2e9368";
constexpr std::int64_t kNow = 1790000000000;

// ---- the document -------------------------------------------------------------------------------

const std::string& document() {
  static const std::string text = test::content_of(FXAGENT_CONTRACT);
  return text;
}

/// Returns the part of `text` after `heading`, up to the next heading that begins with `mark`.
std::string_view below(std::string_view text, const std::string& heading, const std::string& mark) {
  const std::size_t begin = text.find("\n" + heading);
  if (begin == text.npos) return {};
  return text.substr(begin, text.find("\n" + mark, begin + 1) - begin);
}

std::string_view section(int number) {
  return below(document(), "## " + std::to_string(number) + ". ", "## ");
}

std::string_view part(int number, const std::string& name) {
  return below(section(number), "### " + name + "\n", "### ");
}

std::size_t count_of(std::string_view text, std::string_view what) {
  std::size_t count = 0;
  for (std::size_t at = text.find(what); at != text.npos; at = text.find(what, at + 1)) ++count;
  return count;
}

std::set<std::string> words_of(const std::string& text) {
  std::istringstream words(text);
  return std::set<std::string>(std::istream_iterator<std::string>(words),
                               std::istream_iterator<std::string>());
}

std::string in_backticks(std::string_view word) { return "`" + std::string(word) + "`"; }

/// Returns the words in backticks at the start of a table's rows.
std::set<std::string> row_names(std::string_view text) {
  constexpr std::string_view begin = "\n| `";
  constexpr std::string_view end = "` |";
  std::set<std::string> names;
  for (std::size_t at = text.find(begin); at != text.npos; at = text.find(begin, at + 1)) {
    const std::size_t first = at + begin.size();
    names.emplace(text.substr(first, text.find(end, first) - first));
  }
  return names;
}

/// Returns the last cell of the row in section 8 that begins with `limit`.
std::string limit_in_document(const std::string& limit) {
  const std::string_view text = section(8);
  const std::size_t row = text.find("\n| " + limit);
  if (row == text.npos) return "no such row";
  const std::size_t end = text.find(" |\n", row);
  if (end == text.npos) return "no end of row";
  const std::size_t begin = text.rfind("| ", end) + 2;
  return std::string(text.substr(begin, end - begin));
}

/// 65536 as "65,536".
std::string grouped(std::uint64_t number) {
  std::string digits = std::to_string(number);
  for (std::size_t at = digits.size(); at > 3; at -= 3) digits.insert(at - 3, ",");
  return digits;
}

/// The blocks after `<!-- example: NAME -->` by name; empty if no block follows.
const std::map<std::string, std::string>& examples() {
  static const std::map<std::string, std::string> all = [] {
    constexpr std::string_view mark = "<!-- example: ";
    constexpr std::string_view mark_end = " -->";
    constexpr std::string_view fence = "\n```json\n";
    const std::string_view text = document();
    std::map<std::string, std::string> found;
    for (std::size_t at = text.find(mark); at != text.npos; at = text.find(mark, at + 1)) {
      const std::size_t name = at + mark.size();
      const std::size_t name_end = text.find(mark_end, name);
      if (name_end == text.npos) break;
      std::string_view block = text.substr(name_end + mark_end.size());
      if (block.starts_with(fence)) {
        block.remove_prefix(fence.size());
        block = block.substr(0, block.find("\n```"));
      } else {
        block = {};
      }
      found.emplace(text.substr(name, name_end - name), block);
    }
    return found;
  }();
  return all;
}

json example(const std::string& name) {
  const auto found = examples().find(name);
  if (found == examples().end()) {
    ADD_FAILURE() << "no example " << name;
    return json();
  }
  return json::parse(found->second, nullptr, /*allow_exceptions=*/false);
}

// ---- the keys of a payload ----------------------------------------------------------------------

/// True for objects whose keys are names of tags, links and devices.
bool has_names_for_keys(std::string_view key) {
  constexpr std::array<std::string_view, 5> kOfNames{"values", "bad", "tags", "links", "devices"};
  return std::find(kOfNames.begin(), kOfNames.end(), key) != kOfNames.end();
}

void add_keys(const json& value, const std::string& path, bool by_name,
              std::set<std::string>& keys) {
  keys.insert(path + " " + value.type_name());
  if (value.is_object()) {
    for (const auto& item : value.items()) {
      const std::string key = by_name ? std::string("*") : item.key();
      add_keys(item.value(), path + "/" + key, !by_name && has_names_for_keys(key), keys);
    }
  } else if (value.is_array()) {
    for (const json& element : value) add_keys(element, path + "/[]", false, keys);
  }
}

/// Returns every key as a path with the type of its value: "/bad/*/since number". Names of the
/// plant are "*", elements of arrays "[]".
std::set<std::string> keys_of(const json& payload) {
  std::set<std::string> keys;
  add_keys(payload, "", false, keys);
  return keys;
}

/// Compares an example with `made`, the program's output for the same thing.
void expect_same_keys(const std::string& name, const std::string& made) {
  EXPECT_EQ(keys_of(example(name)), keys_of(json::parse(made))) << name << ", made: " << made;
}

// ---- the program's output ----------------------------------------------------------------------

std::string telemetry_text(const Telemetry& message) {
  return test::sample_text(message, kBoot, kMeta);
}

Telemetry sample_message() {
  Telemetry message = test::sample(48211);
  message.span_ms = 24.9;
  message.readings = {test::good(test::temp, Value(23.4)), test::good(test::running, Value(true))};
  return message;
}

CommandResult acknowledged(std::string id) {
  CommandResult result = test::succeeded(std::move(id));
  result.targets[0].plc = PlcAnswer::ack;
  result.targets[0].verify = Verification{Value(std::int64_t{50}), true};
  result.received_ms = kNow;
  result.bound = 230ms;
  result.total = 62ms;
  return result;
}

/// Returns a list result with the target of acknowledged() and another one.
CommandResult list_with(TargetResult second) {
  CommandResult result = acknowledged("b7e3");
  result.is_list = true;
  result.targets.push_back(std::move(second));
  return result;
}

// ---- examples -----------------------------------------------------------------------------------

TEST(ContractExamples, EachIsThereOnceAndNoBlockIsWithoutAName) {
  const std::set<std::string> wanted = words_of(
      "sample sample_bad history agent_state_online agent_state_offline device_state "
      "device_state_offline "
      "meta health "
      "command_write command_force command_list command_run command_read command_force_list "
      "result_ack result_rejected result_expired result_list result_partial result_duplicate "
      "desired reported "
      "yield");
  std::set<std::string> found;
  for (const auto& [name, text] : examples()) found.insert(name);
  EXPECT_EQ(found, wanted);
  EXPECT_EQ(count_of(document(), "```json\n"), wanted.size());
}

TEST(ContractExamples, EachIsJson) {
  ASSERT_FALSE(examples().empty());
  for (const auto& [name, text] : examples()) EXPECT_TRUE(json::accept(text)) << name;
}

TEST(ContractExamples, ParserTakesEveryCommand) {
  std::size_t commands = 0;
  for (const auto& [name, text] : examples()) {
    if (!name.starts_with("command_")) continue;
    ++commands;
    const Command command = parse_command(text);
    EXPECT_FALSE(command.refusal) << name << ": " << command.refusal.value_or(Refusal{}).detail;
    EXPECT_EQ(command.is_list, name.ends_with("_list")) << name;
  }
  EXPECT_EQ(commands, 6U);
}

TEST(ContractExamples, ParserTakesTheCommandForALink) {
  const LinkCommand parsed = parse_link_command(examples().at("yield"));
  EXPECT_FALSE(parsed.command.refusal);
  EXPECT_EQ(parsed.time, 15min);
}

TEST(ContractExamples, SamplesHaveTheKeysOfTheProgram) {
  Telemetry message = sample_message();
  expect_same_keys("sample", telemetry_text(message));
  TagReading pressure;
  pressure.tag = test::pressure;
  pressure.bad = BadReason::timeout;
  pressure.value = Value(5.1);
  pressure.bad_since_ms = kNow - 2000;
  pressure.last_ms = kNow - 3000;
  message.readings.push_back(pressure);
  expect_same_keys("sample_bad", telemetry_text(message));
}

TEST(ContractExamples, HistoryHasTheKeysOfTheProgram) {
  Telemetry message = test::sample(48101, 0, 1);
  message.readings = {test::good(test::setpoint, Value(std::int64_t{50}))};
  const std::string row = encode_sample(message, test::press("press1"), kBoot, kMeta);
  SampleRecord record;
  ASSERT_TRUE(decode_sample(row, record));
  const Config config = test::plant();
  JsonPayload payload(config, kBoot, "0.1.0");
  const auto history = payload.begin_history(65536);
  ASSERT_TRUE(history->add(record) && history->add(record));
  expect_same_keys("history", history->take({"press1", "fast"}).at(0).payload);
}

TEST(ContractExamples, StatesHaveTheKeysOfTheProgram) {
  const Config config = test::plant();
  const JsonPayload payload(config, kBoot, "0.1.0");
  expect_same_keys("agent_state_online",
                   payload.agent_online(kNow, std::nullopt, std::nullopt).payload);
  expect_same_keys("agent_state_offline", payload.last_will().payload);
  DeviceStatus status;
  status.state = DeviceStatus::State::online;
  status.since_ms = kNow;
  status.model = "FX3U";
  status.run = true;
  expect_same_keys("device_state", payload.device_state(status).payload);
  status.state = DeviceStatus::State::offline;
  status.reason = status.reason_text = "link_down";
  status.run.reset();
  expect_same_keys("device_state_offline", payload.device_state(status).payload);
}

TEST(ContractExamples, MetaHasTheKeysOfTheProgram) {
  DeviceConfig device = test::press("press1");
  TagConfig recipe = test::tag("recipe", "D210", DataType::int16, 1);
  recipe.point.is_array = true;
  recipe.point.count = 3;
  recipe.units =
      std::make_shared<const TagUnits>(TagUnits{.limits = {.min = 0, .max = 1000},
                                                .description = "Parts",
                                                .states = {{0, "none"}, {1000, "full"}}});
  device.tags = {device.tags[test::temp], recipe};
  expect_same_keys("meta", fxagent::json::device_meta(device).text);
}

TEST(ContractExamples, HealthHasTheKeysOfTheProgram) {
  Config config = test::plant();
  config.devices.pop_back();
  AgentStatus health;
  health.boot = kBoot;
  health.version = "0.1.0";
  health.store_state = "disk";
  health.hours_left = 812.5;
  health.audit_records = 54;
  health.audit_head = "7d0f";
  expect_same_keys("health", fxagent::json::health(health, config));
}

TEST(ContractExamples, DesiredIsReadAndReportedHasTheKeysOfTheProgram) {
  const auto read = read_desired(examples().at("desired"));
  EXPECT_TRUE(read.errors.empty());
  EXPECT_EQ(read.desired.version, "line2-v7");
  const json made =
      json::parse(RemoteConfig("agent.json", 60s, "9f3c21aa").report_text("5f0c9a31e7d2b846"));
  const json wanted = example("reported");
  for (const auto& [key, value] : wanted.items()) EXPECT_TRUE(made.contains(key)) << key;
  EXPECT_EQ(made.size(), wanted.size());
}

TEST(ContractExamples, SamplesOfHealthAreBalanced) {
  const json health = example("health");
  SampleCounts samples;
  const auto number = [&health](const char* key) {
    return health.at("samples").at(key).get<std::uint64_t>();
  };
  samples.collected = number("collected");
  samples.recovered = number("recovered");
  samples.suppressed = number("suppressed");
  samples.queued = number("queued");
  samples.in_flight = number("in_flight");
  samples.stored = number("stored");
  samples.acknowledged = number("acknowledged");
  samples.dropped = number("dropped");
  EXPECT_TRUE(samples.balanced());
}

TEST(ContractExamples, ResultsOfOneTargetHaveTheKeysOfTheProgram) {
  expect_same_keys("result_ack", with_total(result_text(acknowledged("b7e1")), 62ms));
  CommandResult rejected;
  rejected.id = "b7e5";
  rejected.reason = Reason::unknown_tag;
  rejected.detail = "device press1 has no tag setpiont";
  rejected.op = "write";
  rejected.targets.resize(1);
  rejected.targets[0].tag = "setpiont";
  rejected.targets[0].value = Value(std::int64_t{50});
  expect_same_keys("result_rejected", with_total(result_text(rejected), 1ms));
  rejected.targets[0].address = "D200";
  expect_same_keys("result_expired", with_total(result_text(rejected), 1ms));
}

TEST(ContractExamples, ResultsOfListsHaveTheKeysOfTheProgram) {
  TargetResult second = acknowledged("").targets[0];
  second.tag = "";
  second.address = "D201";
  CommandResult whole = list_with(second);
  whole.one_frame = true;
  expect_same_keys("result_list", with_total(result_text(whole), 120ms));

  second.tag = "speed";
  second.status = CommandStatus::failed;
  second.reason = Reason::nak;
  second.detail = "nak: the protocol gives no reason";
  second.plc = PlcAnswer::nak;
  second.verify.reset();
  CommandResult partial = list_with(second);
  partial.status = CommandStatus::partial;
  partial.reason = second.reason;
  partial.detail = second.detail;
  partial.plc = second.plc;
  partial.progress = Progress{1, 2};
  expect_same_keys("result_partial", with_total(result_text(partial), 155ms));
}

TEST(ContractExamples, DuplicateHasTheKeysOfTheProgram) {
  CommandResult again;
  again.id = "b7e1";
  again.status = CommandStatus::duplicate;
  again.reason = Reason::duplicate_id;
  again.plc = PlcAnswer::ack;
  again.op = "write";
  again.targets.resize(1);
  again.targets[0].tag = "setpoint";
  again.targets[0].value = Value(std::int64_t{50});
  again.first = std::make_shared<const CommandResult>(acknowledged("b7e1"));
  expect_same_keys("result_duplicate", with_total(result_text(again), 1ms));
}

// ---- words --------------------------------------------------------------------------------------

/// Returns all words of Reason in order. to_string() returns "" past the last enumerator.
std::vector<std::string> reason_words() {
  std::vector<std::string> words;
  for (int i = static_cast<int>(Reason::none) + 1; i <= static_cast<int>(Reason::interrupted); ++i)
    words.emplace_back(to_string(static_cast<Reason>(i)));
  return words;
}

TEST(ContractWords, EveryReasonHasItsRowAndNoOtherHas) {
  const std::vector<std::string> words = reason_words();
  EXPECT_EQ(row_names(part(5, "Reasons")), std::set<std::string>(words.begin(), words.end()));
}

TEST(ContractWords, EveryStatusHasItsRowAndNoOtherHas) {
  std::set<std::string> words;
  for (const CommandStatus status : kCommandStatuses) words.emplace(to_string(status));
  EXPECT_EQ(row_names(part(5, "Statuses")), words);
}

TEST(ContractWords, EveryBadReasonHasItsRowAndNoOtherHas) {
  std::set<std::string> words;
  for (const BadReason why : {BadReason::timeout, BadReason::nak, BadReason::bad_frame,
                              BadReason::link_down, BadReason::unsupported, BadReason::bad_value})
    words.emplace(to_string(why));
  EXPECT_EQ(row_names(part(4, "Why a value is bad")), words);
}

TEST(ContractWords, EveryOperationIsNamed) {
  const std::string_view keys = part(5, "The command");
  for (const Op op : {Op::write, Op::force_on, Op::force_off, Op::read, Op::run, Op::stop})
    EXPECT_NE(keys.find(in_backticks(to_string(op))), keys.npos) << to_string(op);
}

TEST(ContractWords, EveryStateAndAnswerIsNamed) {
  using State = DeviceStatus::State;
  const std::string_view states = part(3, "State and meta of a device");
  for (const State state : {State::offline, State::degraded, State::online})
    EXPECT_NE(states.find(in_backticks(to_string(state))), states.npos) << to_string(state);
  const std::string_view result = part(5, "The result");
  for (const PlcAnswer answer : {PlcAnswer::ack, PlcAnswer::nak})
    EXPECT_NE(result.find(in_backticks(to_string(answer))), result.npos) << to_string(answer);
}

TEST(ContractWords, ParserKnowsEveryKeyOfACommand) {
  const std::set<std::string> keys = row_names(part(5, "The command"));
  ASSERT_TRUE(keys.contains("id") && keys.contains("by"));
  for (const std::string& key : keys) {
    const Command command = parse_command("{\"" + key + "\":null}");
    ASSERT_TRUE(command.refusal) << key;
    EXPECT_EQ(to_string(command.refusal->reason), to_string(Reason::missing_id)) << key;
  }
}

TEST(ContractWords, ChecksStandInTheOrderOfTheProgram) {
  const std::string_view checks = part(5, "Order of checks");
  // A known id comes first; the other checks follow the order of the enumerators.
  std::size_t last = checks.find(in_backticks(to_string(Reason::duplicate_id)));
  ASSERT_NE(last, checks.npos);
  for (const std::string& word : reason_words()) {
    if (word == to_string(Reason::duplicate_id)) continue;
    if (word == to_string(Reason::expect_mismatch)) break;  // outcomes from here on
    const std::size_t at = checks.find(in_backticks(word));
    ASSERT_NE(at, checks.npos) << word;
    EXPECT_GT(at, last) << word;
    last = at;
  }
}

// ---- numbers ------------------------------------------------------------------------------------

TEST(ContractNumbers, LimitsAreThoseOfTheProgram) {
  EXPECT_EQ(limit_in_document("bytes of a command"), grouped(kMaxMessageBytes));
  EXPECT_EQ(limit_in_document("bytes of a result"), grouped(kMaxResultBytes));
  EXPECT_EQ(limit_in_document("targets of a command"), grouped(kMostTargets));
  EXPECT_EQ(limit_in_document("ids of a device"), grouped(kRememberedIds));
  EXPECT_EQ(limit_in_document("ids of refused commands"), grouped(kRememberedRefused));
  EXPECT_EQ(limit_in_document("ids of the agent"), grouped(kFingerprints));
  EXPECT_EQ(limit_in_document("hours that an id is remembered"),
            grouped(static_cast<std::uint64_t>(kRememberedFor.count())));
}

TEST(ContractNumbers, SizesOfConfigsAreThoseOfTheProgram) {
  const ConfigSize& most = kRemoteLimits.most;
  EXPECT_EQ(limit_in_document("values of JSON in a remote config"), grouped(kMaxDesiredValues));
  EXPECT_EQ(limit_in_document("links of a remote config"), grouped(most.links));
  EXPECT_EQ(limit_in_document("devices of a remote config"), grouped(most.devices));
  EXPECT_EQ(limit_in_document("groups of a remote config"), grouped(most.groups));
  EXPECT_EQ(limit_in_document("tags of a remote config"), grouped(most.tags));
  EXPECT_EQ(limit_in_document("values of all tags of a remote config"), grouped(most.values));
  EXPECT_EQ(limit_in_document("MiB of memory"), grouped(kRemoteLimits.memory >> 20));
  EXPECT_EQ(limit_in_document("MiB of the devices of templates"),
            grouped(kRemoteLimits.written >> 20));
  EXPECT_EQ(limit_in_document("tags of a config file"), grouped(kFileLimits.most.tags));
  EXPECT_EQ(limit_in_document("values of all tags of a config file"),
            grouped(kFileLimits.most.values));
}

TEST(ContractNumbers, IdMayBeAsLongAsTheDocumentSays) {
  const std::string limit = limit_in_document("characters of an id");
  ASSERT_EQ(limit.find_first_not_of("0123456789"), limit.npos) << limit;
  const auto read_id = [](std::size_t length) {
    return parse_command("{\"op\":\"run\",\"id\":\"" + std::string(length, 'x') + "\"}").id;
  };
  const std::size_t most = std::stoul(limit);
  EXPECT_EQ(read_id(most).size(), most);
  EXPECT_EQ(read_id(most + 1), "");
}

TEST(ContractNumbers, DefaultsOfCommandsAreThoseOfTheProgram) {
  const CommandRules rules{};
  EXPECT_EQ(limit_in_document("`queue`"), grouped(rules.queue));
  EXPECT_EQ(limit_in_document("`default_expiry_s`"),
            grouped(static_cast<std::uint64_t>(rules.default_expiry.count())));
  EXPECT_EQ(limit_in_document("`max_expiry_s`"),
            grouped(static_cast<std::uint64_t>(rules.max_expiry.count())));
}

}  // namespace
}  // namespace fxagent
