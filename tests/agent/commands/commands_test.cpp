#include "agent/commands/commands.h"

#include <gtest/gtest.h>

#include <functional>
#include <nlohmann/json.hpp>
#include <span>

#include "tests/agent/uplink/plant.h"

namespace fxagent {
namespace {

using nlohmann::json;
using std::chrono::milliseconds;

constexpr std::int64_t kNow = 1790000000000;
const SteadyTime kStart{std::chrono::hours(1)};

class Starts final : public CommandStarts {
  void mark(std::uint64_t, Done done) override { done(true); }
};

/// Keeps all entries and records its calls in order.
class FakeJournal final : public CommandJournal {
 public:
  std::uint64_t next_command_number() override { return ++last_number; }
  void note(std::string audit) override {
    if (!audit.empty()) audits.push_back(json::parse(audit));
  }
  bool journal(std::span<const JournalEntry> commands) override {
    happened += "journal " + std::to_string(commands.size()) + "; ";
    for (const JournalEntry& entry : commands) keep(entry);
    return true;
  }
  using CommandJournal::record;
  void record(std::vector<JournalEntry> given) override {
    happened += "record " + std::to_string(given.size()) + "; ";
    for (const JournalEntry& entry : given) keep(entry);
  }
  void acknowledge(std::string device, std::string id, std::uint64_t number,
                   std::string total_ms) override {
    happened += "acknowledge " + device + " " + id + " " + std::to_string(number) + "; ";
    totals[device + "/" + id] = std::move(total_ms);
  }
  std::optional<JournalEntry> find(const std::string& device, const std::string& id) override {
    const auto found = entries.find(device + "/" + id);
    return found == entries.end() ? std::nullopt : std::optional(found->second);
  }
  bool hangs() const override { return disk_hangs; }
  bool was_read() const override { return !disk_hangs && is_readable; }
  std::vector<KnownId> known_ids(const std::string& device) override {
    asked.push_back(device);
    return {};
  }
  std::vector<JournalEntry> unacknowledged(const std::string&) override { return {}; }
  CommandStarts* starts() override { return &started; }

  void keep(const JournalEntry& entry) {
    entries[entry.device + "/" + entry.id] = entry;
    note(entry.audit);
  }

  std::map<std::string, JournalEntry> entries;
  std::map<std::string, std::string> totals;
  std::vector<json> audits;
  std::string happened;
  std::uint64_t last_number = 0;
  std::vector<std::string> asked;  ///< devices whose earlier runs were asked for
  bool disk_hangs = false;
  bool is_readable = true;
  Starts started;
};

struct CommandsTest : ::testing::Test {
  /// Delivers a message for press1 and handles its immediate effects.
  void receive(const std::string& payload, std::uint32_t device = 0) {
    MessageProperties properties;
    properties.received = now;
    properties.received_ms = kNow;
    commands().receive(config.devices.at(device).name, "any/topic", payload, properties, now, kNow);
  }
  void write(const std::string& id, std::uint32_t device = 0) {
    receive(R"({"id":")" + id + R"(","op":"write","tag":"setpoint","value":50})", device);
  }
  /// Delivers a write and hands what waits to the field.
  void order(const std::string& id) {
    write(id);
    commands().hand_over(kNow);
  }
  void carry_out(const std::string& id) {
    order(id);
    finish(id);
  }
  void finish(const std::string& id) {
    CommandResult result = test::succeeded(id);
    for (const AdmittedCommand& each : admitted)
      if (each.command.id == id) result.number = each.command.number;
    commands().finish(std::move(result), kNow);
  }
  std::vector<json> results() {
    std::vector<json> found;
    for (const ResultMessage& result : commands().results().take())
      found.push_back(json::parse(result.text));
    return found;
  }
  /// Exactly so many results; otherwise the test ends here.
  std::vector<json> results(std::size_t count) {
    std::vector<json> found = results();
    if (found.size() != count) throw std::runtime_error(json(found).dump(1));
    return found;
  }
  /// Ends the run in the middle of a write. Returns what the next one finds.
  Recovered interrupt(const std::string& id) {
    order(id);
    made.reset();
    admitted.clear();
    journal.happened.clear();
    return recover(config, journal, {}, {journal.entries.at("press1/" + id)}, kNow, now);
  }
  Commands& commands() {
    if (!made)
      made = std::make_unique<Commands>(
          config,
          [this](AdmittedCommand each) {
            journal.happened += "submit " + each.command.id + "; ";
            admitted.push_back(std::move(each));
          },
          journaling ? &journal : nullptr);
    return *made;
  }

  Config config = test::plant();
  bool journaling = true;
  FakeJournal journal;
  std::vector<AdmittedCommand> admitted;
  std::unique_ptr<Commands> made;
  SteadyTime now = kStart;
};

TEST_F(CommandsTest, AreInTheJournalInOneCommitBeforeTheFieldGetsThem) {
  write("a");
  receive(R"({"id":"bad","op":"write","tag":"nothing","value":1})");
  write("b");
  EXPECT_EQ(journal.happened, "");
  commands().hand_over(kNow);
  EXPECT_EQ(journal.happened, "journal 2; submit a; submit b; ");
  commands().hand_over(kNow);
  EXPECT_EQ(journal.happened, "journal 2; submit a; submit b; ") << "once";
  const JournalEntry& entry = journal.entries.at("press1/a");
  EXPECT_EQ(entry.op, "write");
  EXPECT_EQ(entry.number, 1U);
  EXPECT_EQ(entry.received_ms, kNow);
  EXPECT_EQ(entry.deadline_ms, kNow + 10000);
  EXPECT_NE(entry.payload.find("setpoint"), std::string::npos);
}

TEST_F(CommandsTest, ResultsAreInTheJournalInOneCommitBeforeTheyAreTaken) {
  write("a");
  write("b");
  commands().hand_over(kNow);
  journal.happened.clear();
  finish("a");
  finish("b");
  receive("{}");
  EXPECT_EQ(journal.happened, "");
  const auto taken = results(3);
  EXPECT_EQ(journal.happened, "record 2; ") << "what has no id is in the audit alone";
  EXPECT_EQ(json::parse(journal.entries.at("press1/b").result), taken[1]);
  EXPECT_EQ(journal.audits.size(), 5U);
}

TEST_F(CommandsTest, EachIsCarriedOutOnce) {
  write("a");
  write("a");
  commands().hand_over(kNow);
  write("a");
  finish("a");
  order("a");
  EXPECT_EQ(admitted.size(), 1U);
  const auto taken = results(4);
  EXPECT_EQ(taken[0]["first"], nullptr) << "still pending";
  EXPECT_EQ(taken[1]["first"], nullptr);
  EXPECT_EQ(taken[2]["status"], "SUCCEEDED");
  EXPECT_EQ(taken[3]["status"], "DUPLICATE");
  EXPECT_EQ(taken[3]["first"], taken[2]);
  EXPECT_EQ(taken[3]["plc"], "ACK");
}

TEST_F(CommandsTest, WhatCannotBeJournaledIsRefusedAndNeverCarriedOut) {
  journal.disk_hangs = true;
  write("a");
  receive(R"({"id":"look","op":"read","tag":"setpoint"})");
  order("b");
  ASSERT_EQ(admitted.size(), 1U) << "a read changes nothing";
  EXPECT_EQ(admitted[0].command.id, "look");
  const auto taken = results(2);
  for (const json& result : taken) {
    EXPECT_EQ(result["status"], "REJECTED");
    EXPECT_EQ(result["reason"], "store_unavailable");
    EXPECT_EQ(result["plc"], nullptr);
  }
  journal.disk_hangs = false;
  commands().hand_over(kNow);
  EXPECT_EQ(admitted.size(), 1U);
  write("a");
  ASSERT_EQ(results().size(), 1U) << "a DUPLICATE, at once";
  order("c");
  EXPECT_EQ(admitted.back().command.id, "c") << "the queue has room again";
}

TEST_F(CommandsTest, FirstResultThatTheDiskDoesNotGiveIsNotSaidToBeLost) {
  carry_out("a");
  results();
  journal.entries.clear();
  journal.disk_hangs = true;
  write("a");
  const auto taken = results(1);
  EXPECT_EQ(taken[0]["status"], "DUPLICATE");
  EXPECT_EQ(taken[0]["detail"],
            "the store's disk does not respond, so the first result cannot be read; the command is "
            "not repeated");
}

TEST_F(CommandsTest, WithoutAJournalFirstResultsAreRememberedHere) {
  journaling = false;
  carry_out("a");
  write("a");
  const auto taken = results(2);
  EXPECT_EQ(taken[1]["first"], taken[0]);
  EXPECT_EQ(journal.happened, "submit a; ");
}

TEST_F(CommandsTest, RefusedOneIsTheFirstOfItsRepeatInTheSameStep) {
  const std::string bad = R"({"id":"bad","op":"write","tag":"nothing","value":1})";
  receive(bad);
  receive(bad);
  const auto taken = results(2);
  EXPECT_EQ(taken[1]["first"], taken[0]);
}

TEST_F(CommandsTest, FirstResultThatIsLostIsSaidToBeLost) {
  carry_out("a");
  EXPECT_EQ(results().size(), 1U);
  journal.entries.at("press1/a").number = 9;  // belongs to another command
  write("a");
  journal.entries.clear();
  write("a");
  for (const json& result : results()) {
    EXPECT_EQ(result["status"], "DUPLICATE");
    EXPECT_EQ(result["first"], nullptr);
    EXPECT_EQ(result["detail"],
              "the first result is no longer in the journal; the command is not repeated");
  }
}

TEST_F(CommandsTest, QueueIsPerDeviceAndAnswersWhenFull) {
  config.devices[0].commands.queue = 3;
  for (int i = 0; i < 6; ++i) write("c" + std::to_string(i));
  write("c", 1);
  commands().hand_over(kNow);
  EXPECT_EQ(admitted.size(), 5U) << "one on the wire, three that wait, and the neighbour's";
  auto taken = results(2);
  for (const json& result : taken) EXPECT_EQ(result["reason"], "queue_full");
  finish("c0");
  order("next");
  EXPECT_EQ(admitted.size(), 6U);
}

TEST_F(CommandsTest, IdOfAnEarlierRunIsADuplicate) {
  Recovered known;
  known.ids.push_back({"press1", "old", 7, kNow - 1000, kNow - 1000});
  JournalEntry old;
  old.device = "press1";
  old.id = "old";
  old.number = 7;
  old.result = R"({"id":"old","status":"SUCCEEDED","plc":"ACK"})";
  journal.keep(old);
  commands().restore(std::move(known), now, kNow);
  write("old");
  const auto taken = results(1);
  EXPECT_EQ(taken[0]["status"], "DUPLICATE");
  EXPECT_EQ(taken[0]["first"], json::parse(old.result));
}

TEST_F(CommandsTest, InterruptedWriteGoesToTheFieldToBeReadAndIsNotJournaledAgain) {
  Recovered known = interrupt("left");
  config.hash = "another";  // a comment was edited
  commands().restore(std::move(known), now, kNow);
  ASSERT_EQ(admitted.size(), 1U);
  EXPECT_TRUE(admitted[0].interrupted);
  EXPECT_EQ(journal.happened, "submit left; ");
  write("left");
  EXPECT_EQ(results().at(0)["status"], "DUPLICATE");
}

TEST_F(CommandsTest, InterruptedWriteWhosePlaceHasChangedIsNotReadBack) {
  const Config before = config;
  const auto setpoint = [](Config& next) -> Point& {
    return next.devices[0].tags[test::setpoint].point;
  };
  const std::vector<std::function<void(Config&)>> changes{
      [](Config& next) {  // "host": "${PLC_HOST}"
        next.links[next.devices[0].link].channel = TcpSettings{.host = "10.0.0.8", .port = 5551};
      },
      [&](Config& next) { setpoint(next).address.span.first_bit += 16; },
      [&](Config& next) { setpoint(next).scale = 10; },
      [](Config& next) {
        next.devices[0].options =
            std::make_shared<const Options>(Options{{"station", std::int64_t{3}}});
      }};
  for (const auto& change : changes) {
    made.reset();
    config = before;
    const std::string id = "left" + std::to_string(&change - changes.data());
    Recovered known = interrupt(id);
    ASSERT_EQ(known.interrupted.size(), 1U);
    change(config);
    commands().restore(std::move(known), now, kNow);
    EXPECT_TRUE(admitted.empty()) << id;
    const json result = results(1)[0];
    EXPECT_EQ(result["id"], id);
    EXPECT_EQ(result["status"], "UNKNOWN_OUTCOME");
    EXPECT_EQ(result["reason"], "interrupted");
    EXPECT_EQ(result["tag"], "setpoint");
  }
}

TEST_F(CommandsTest, KnownIdOfATooLargeCommandIsADuplicate) {
  const std::string large = R"({"id":"a","by":")" + std::string(65536, 'x') + "\"}";
  write("a");
  receive(large);
  const auto taken = results(1);
  EXPECT_EQ(taken[0]["status"], "DUPLICATE");
  EXPECT_EQ(taken[0]["id"], "a");
}

TEST_F(CommandsTest, FieldIsToldWhoKnowsWhichCommandsHaveStarted) {
  order("a");
  ASSERT_EQ(admitted.size(), 1U);
  EXPECT_EQ(admitted[0].starts, &journal.started);
}

TEST_F(CommandsTest, EachTargetOfAnInterruptedListIsUnknownWhereAReadDoesNotTell) {
  config.devices[0].tags[test::running].writable = true;
  Recovered known;
  Command list;
  list.id = "list";
  list.op = Op::write;
  list.op_text = "write";
  list.is_list = true;
  list.targets.push_back({"setpoint", "", std::nullopt, Value(std::int64_t{50})});
  list.targets.push_back({"running", "", std::nullopt, Value(Scalar(true))});
  known.interrupted.push_back({list, {}});
  commands().restore(std::move(known), now, kNow);
  EXPECT_TRUE(admitted.empty());
  const auto taken = results(1);
  EXPECT_EQ(taken[0]["status"], "UNKNOWN_OUTCOME");
  ASSERT_EQ(taken[0]["targets"].size(), 2U);
  EXPECT_EQ(taken[0]["reason"], "interrupted");
  for (const json& target : taken[0]["targets"]) {
    EXPECT_EQ(target["status"], "UNKNOWN_OUTCOME");
    EXPECT_EQ(target["reason"], "interrupted");
  }
  write("list");
  EXPECT_EQ(results().at(0)["status"], "DUPLICATE");
}

TEST_F(CommandsTest, DeliveryIsNotedForWhatTheJournalHas) {
  carry_out("a");
  receive("{}");
  const auto taken = commands().results().take();
  ASSERT_EQ(taken.size(), 2U);
  journal.happened.clear();
  journal.audits.clear();
  for (const ResultMessage& each : taken) commands().results().note_delivery(each, true, kNow + 5);
  EXPECT_EQ(journal.happened, "acknowledge press1 a 1; ");
  ASSERT_EQ(journal.audits.size(), 2U);
  EXPECT_EQ(journal.audits[1]["acknowledged"], true);
  EXPECT_EQ(journal.audits[1]["ts"], kNow + 5);
}

TEST_F(CommandsTest, ResultOfAnEarlierRunIsPublishedAsItWas) {
  Recovered known;
  CommandResult result;
  result.id = "old";
  result.status = CommandStatus::succeeded;
  result.recorded = R"({"id":"old","t":{"total_ms":null}})";
  known.unacknowledged.push_back(result);
  commands().restore(std::move(known), now, kNow);
  const auto taken = commands().results().take();
  ASSERT_EQ(taken.size(), 1U);
  EXPECT_EQ(taken[0].text, result.recorded);
  EXPECT_TRUE(taken[0].recorded);
  EXPECT_TRUE(taken[0].is_first);
  EXPECT_EQ(journal.happened, "") << "it is there already";
}

TEST_F(CommandsTest, NothingIsAdmittedAfterTheEndWasAskedFor) {
  order("before");
  commands().close();
  write("before");
  write("after");
  receive("no json");
  commands().hand_over(kNow);
  EXPECT_EQ(admitted.size(), 1U);
  const auto taken = results(3);
  EXPECT_EQ(taken[0]["status"], "DUPLICATE");
  EXPECT_EQ(taken[1]["reason"], "shutting_down");
  EXPECT_EQ(taken[2]["reason"], "bad_json") << "shutting_down is the last of the checks";
  EXPECT_EQ(taken[2]["id"], nullptr);
}

TEST_F(CommandsTest, RefusedAndExpiredIdsAreMarkedInTheJournal) {
  write("done");
  receive(R"({"id":"bad","op":"write","tag":"nowhere","value":1})");
  receive(R"({"id":"late","op":"write","tag":"setpoint","value":5,"expires":1789999990000})");
  commands().hand_over(kNow);
  finish("done");
  EXPECT_EQ(results().back()["status"], "SUCCEEDED");
  EXPECT_FALSE(journal.entries.at("press1/done").refused);
  EXPECT_TRUE(journal.entries.at("press1/bad").refused);
  EXPECT_TRUE(journal.entries.at("press1/late").refused);
}

TEST_F(CommandsTest, TotalOfAnEarlierResultIsKnownToItsDuplicate) {
  for (const char* id : {"a", "b"}) write(id);
  commands().hand_over(kNow);
  for (const char* id : {"a", "b"}) finish(id);
  auto taken = commands().results().take();
  ASSERT_EQ(taken.size(), 2U);
  for (ResultMessage& each : taken) {
    each.total = milliseconds(120);
    commands().results().note_total(each);
  }
  for (const char* id : {"a", "b"}) {
    write(id);
    EXPECT_EQ(results().at(0)["first"]["t"]["total_ms"], 120) << id;
  }
}

TEST_F(CommandsTest, EachResultIsCounted) {
  write("a");
  carry_out("a");
  EXPECT_EQ(commands().results().counts().at(CommandStatus::succeeded), 1U);
  EXPECT_EQ(commands().results().counts().at(CommandStatus::duplicate), 1U);
}

TEST_F(CommandsTest, LastOnesAreKnownWithWhatBecameOfThem) {
  write("a");
  receive(R"({"id":"b","op":"write","tag":"nowhere","value":1})", 1);
  commands().hand_over(kNow);
  finish("a");
  const auto& last = commands().results().last();
  ASSERT_EQ(last.size(), 2U);
  EXPECT_EQ(last[0]->device, "press2");
  EXPECT_EQ(last[0]->id, "b");
  EXPECT_EQ(last[0]->op, "write");
  EXPECT_EQ(last[0]->status, CommandStatus::rejected);
  EXPECT_EQ(last[0]->reason, Reason::unknown_tag);
  EXPECT_EQ(last[0]->ts_ms, kNow);
  EXPECT_EQ(last[1]->device, "press1");
  EXPECT_EQ(last[1]->id, "a");
  EXPECT_EQ(last[1]->status, CommandStatus::succeeded);
  EXPECT_EQ(last[1]->reason, Reason::none);
  EXPECT_EQ(last[1]->number, 2U);
  for (std::size_t i = 0; i < kLastCommands; ++i) receive("no json");
  EXPECT_EQ(last.size(), kLastCommands);
  EXPECT_EQ(last.front()->reason, Reason::bad_json);
  EXPECT_EQ(last.back()->number, kLastCommands + 2);
}

TEST_F(CommandsTest, LargeRefusedCommandsTakeBoundedMemory) {
  journaling = false;
  const std::string text(60'000, 'y');
  const auto send = [&](int i) {
    receive(R"({"id":"r)" + std::to_string(i) + R"(","op":"write","tag":"nowhere","value":")" +
            text + R"("})");
    return results(1)[0];
  };
  constexpr int kMany = 150;  // of 9 MB
  for (int i = 0; i < kMany; ++i) EXPECT_EQ(send(i)["reason"], "unknown_tag");
  const json oldest = send(0);
  EXPECT_EQ(oldest["status"], "DUPLICATE");
  EXPECT_EQ(oldest["first"], nullptr);
  EXPECT_NE(oldest["detail"].dump().find("no longer kept"), std::string::npos);
  EXPECT_EQ(send(kMany - 1)["first"]["reason"], "unknown_tag");
}

TEST_F(CommandsTest, RefusedCommandsTakeNoRoomFromTheResultsOfOthers) {
  journaling = false;
  carry_out("a");
  results();
  const std::string text(60'000, 'y');
  for (int i = 0; i < 150; ++i)  // of 9 MB
    receive(R"({"id":"r)" + std::to_string(i) + R"(","op":"write","tag":"nowhere","value":")" +
            text + R"("})");
  results();
  write("a");
  EXPECT_EQ(results(1)[0]["first"]["status"], "SUCCEEDED");
}

TEST_F(CommandsTest, LastCommandHasTheBeginningOfAnArray) {
  json command = {{"id", "a"}, {"op", "write"}, {"tag", "nowhere"}};
  command["value"] = std::vector<int>(30'000, 1);
  receive(command.dump());
  const Scalars& items = commands().results().last().at(0)->value.items;
  ASSERT_EQ(items.size(), 17U);
  EXPECT_EQ(std::get<std::int64_t>(items[15]), 1);
  EXPECT_EQ(std::get<std::string>(items[16]), "…");
}

TEST_F(CommandsTest, LastCommandHasTheBeginningOfALongText) {
  receive(R"({"id":"a","op":"write","tag":"nowhere","value":"x)" + std::string(60000, 'y') +
          R"(","by":")" + std::string(63, 'z') + R"(öz"})");
  const LastCommand& last = *commands().results().last().at(0);
  EXPECT_EQ(std::get<std::string>(last.value.items.at(0)), "x" + std::string(63, 'y') + "…");
  EXPECT_EQ(last.by, std::string(63, 'z') + "…") << "no half character";
}

TEST_F(CommandsTest, ResultThatAnEarlierRunGaveIsNoLastOne) {
  Recovered known;
  CommandResult result;
  result.id = "old";
  result.recorded = R"({"id":"old"})";
  known.unacknowledged.push_back(result);
  commands().restore(std::move(known), now, kNow);
  EXPECT_TRUE(commands().results().last().empty());
}

// ---- a changed config ---------------------------------------------------------------------------

struct CommandsChangeTest : CommandsTest {
  Config without_press1() const {
    Config wanted = config;
    wanted.devices = {config.devices[1]};
    return wanted;
  }
  Config with_oven() const {
    Config wanted = config;
    wanted.devices.push_back(test::press("oven"));
    return wanted;
  }
  /// Begins a change as the publisher does; the config is switched later.
  void begin_change(Config wanted) {
    change = change_between(config, std::move(wanted));
    commands().begin_change(change);
  }
  /// Returns the devices whose earlier runs are asked.
  std::vector<std::string> end_change() {
    config = change.config;
    commands().change(change, now);
    commands().recover_joined(now, kNow);
    return std::exchange(journal.asked, {});
  }
  ConfigChange change;
};

TEST_F(CommandsChangeTest, DeviceOfTheSameNameKnowsItsIdsAndObeysItsNewRules) {
  carry_out("a");
  results();
  Config wanted = config;
  wanted.devices[0].tags[test::setpoint].writable = false;
  begin_change(std::move(wanted));
  write("b");
  EXPECT_EQ(results().at(0)["reason"], "reloading");
  EXPECT_TRUE(end_change().empty());
  write("a");
  write("b");
  write("c");
  const auto after = results(3);
  EXPECT_EQ(after[0]["status"], "DUPLICATE");
  EXPECT_EQ(after[0]["first"]["status"], "SUCCEEDED");
  EXPECT_EQ(after[1]["status"], "DUPLICATE") << "each id has one result";
  EXPECT_EQ(after[2]["reason"], "not_writable");
}

TEST_F(CommandsChangeTest, NeighbourOfADeviceThatChangesIsNotConcerned) {
  commands();
  Config wanted = config;
  wanted.devices[1].retries = 7;
  begin_change(std::move(wanted));
  order("a");
  EXPECT_EQ(admitted.size(), 1U);
  end_change();
  finish("a");
  EXPECT_EQ(results().at(0)["status"], "SUCCEEDED");
}

TEST_F(CommandsChangeTest, DeviceOfAnotherIntervalAdmitsAllTheTime) {
  write("a");
  Config wanted = config;
  wanted.devices[0].groups.at(0).interval += std::chrono::milliseconds(1);
  begin_change(std::move(wanted));
  write("b");
  EXPECT_TRUE(end_change().empty());
  change = {};  // the config of before is gone
  order("c");
  EXPECT_EQ(admitted.size(), 3U);
  EXPECT_TRUE(results().empty());
  commands().close();
  change = change_between(config, config);
  change.devices_adjusted = {0};
  end_change();
  write("d");
  EXPECT_EQ(results().at(0)["reason"], "shutting_down") << "the agent is stopping all the same";
}

TEST_F(CommandsChangeTest, DeviceThatComesBackKnowsTheIdsOfBefore) {
  for (const bool with_journal : {true, false}) {
    made.reset();
    admitted.clear();
    config = test::plant();
    journaling = with_journal;
    carry_out("a");
    results();
    const Config both = config;
    begin_change(without_press1());
    EXPECT_TRUE(end_change().empty());
    EXPECT_FALSE(commands().device_named("press1"));
    EXPECT_EQ(commands().device_named("press2"), 1U);
    begin_change(both);
    EXPECT_TRUE(end_change().empty()) << "this run has known it";
    write("a");
    EXPECT_EQ(results().at(0)["status"], "DUPLICATE");
  }
}

TEST_F(CommandsChangeTest, DeviceThatIsGoneIsForgottenWithItsLastId) {
  carry_out("a");
  results();
  const Config both = config;
  const Config one = without_press1();
  for (const auto& [later, is_known] :
       {std::pair(std::chrono::hours(23), true), std::pair(std::chrono::hours(2), false)}) {
    begin_change(one);
    end_change();
    now += later;
    begin_change(both);
    EXPECT_EQ(end_change().empty(), is_known) << "else earlier runs are asked: " << later.count();
  }
}

TEST_F(CommandsChangeTest, IdThatIsFoundLateIsKnownToADeviceThatIsGone) {
  carry_out("a");
  results();
  const Config both = config;
  begin_change(without_press1());
  end_change();
  Recovered late;
  late.ids.push_back({"press1", "old", 7, kNow - 1000, kNow - 1000});
  commands().restore(std::move(late), now, kNow);
  begin_change(both);
  end_change();
  write("old");
  EXPECT_EQ(results().at(0)["status"], "DUPLICATE");
}

TEST_F(CommandsChangeTest, EarlierRunsAreAskedForADeviceThatIsNew) {
  commands();
  begin_change(with_oven());
  journal.disk_hangs = true;
  EXPECT_TRUE(end_change().empty()) << "a disk that hangs is not asked";
  journal.disk_hangs = false;
  commands().recover_joined(now, kNow);
  EXPECT_EQ(journal.asked, std::vector<std::string>{"oven"});
  write("a", 2);
  commands().hand_over(kNow);
  ASSERT_EQ(admitted.size(), 1U);
  EXPECT_EQ(admitted[0].command.device, 2U);
}

TEST_F(CommandsChangeTest, EarlierRunsAreAskedAgainIfTheirReadFailed) {
  commands();
  begin_change(with_oven());
  journal.is_readable = false;
  end_change();
  journal.is_readable = true;
  commands().recover_joined(now, kNow);
  EXPECT_EQ(journal.asked, std::vector<std::string>{"oven"});
  commands().recover_joined(now, kNow);
  EXPECT_EQ(journal.asked, std::vector<std::string>{"oven"}) << "once";
}

TEST_F(CommandsChangeTest, ResultOfADeviceThatIsGoneIsStillAcknowledged) {
  order("a");
  begin_change(without_press1());
  finish("a");
  auto left = commands().results().take();
  end_change();
  ASSERT_EQ(left.size(), 1U);
  EXPECT_EQ(left[0].device, "press1");
  commands().results().note_total(left[0]);
  commands().results().note_delivery(left[0], true, kNow);
  EXPECT_NE(journal.happened.find("acknowledge press1 a"), std::string::npos);
}

TEST_F(CommandsChangeTest, DeviceThatBeginsDuringTheEndAdmitsNothing) {
  commands();
  Config wanted = with_oven();
  wanted.devices[0].retries = 7;
  begin_change(std::move(wanted));
  commands().close();
  end_change();
  for (const std::uint32_t device : {0U, 2U}) {
    write("a", device);
    EXPECT_EQ(results().at(0)["reason"], "shutting_down");
  }
}

TEST_F(CommandsChangeTest, DeviceThatBeginsWhileAnotherAgentHasOurIdRefusesToo) {
  commands().set_conflict("deadbeef");
  Config wanted = with_oven();
  wanted.devices[0].retries = 7;
  begin_change(std::move(wanted));
  end_change();
  for (const std::uint32_t device : {0U, 2U}) {
    write("a", device);
    EXPECT_EQ(results().at(0)["reason"], "conflict");
  }
}

}  // namespace
}  // namespace fxagent
