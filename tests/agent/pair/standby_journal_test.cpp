#include "agent/pair/standby_journal.h"

#include <gtest/gtest.h>

#include <chrono>

#include "agent/commands/audit_records.h"
#include "agent/pair/pair_messages.h"
#include "agent/store/journal/unrecorded_file.h"
#include "tests/support/scratch.h"

namespace fxagent {
namespace {

constexpr const char* kTopic = "fx/p/pair/a/journal";

std::string result(const std::string& id, const std::string& status) {
  return R"({"id":")" + id + R"(","op":"write","status":")" + status + R"("})";
}

JournalEntry command(const std::string& id, const char* op = "write") {
  JournalEntry made;
  made.device = "press1";
  made.id = id;
  made.op = op;
  made.received_ms = utc_ms(std::chrono::system_clock::now());
  made.deadline_ms = made.received_ms + 10000;
  return made;
}

struct StandbyJournalTest : ::testing::Test {
  StandbyJournalTest() { config_.path = scratch_.path("store"); }

  void stand_by() {
    journal_.reset();
    journal_ = std::make_unique<StandbyJournal>(config_);
  }
  /// Ends the standby. Returns the same store, as the agent opens it after a takeover.
  Store& take_over_store() {
    EXPECT_EQ(journal_->close().size(), 0U);
    journal_.reset();
    return open_store();
  }
  Store& open_store() {
    store_.reset();
    store_ = std::make_unique<Store>(config_, utc_ms(std::chrono::system_clock::now()));
    return *store_;
  }
  /// The commands that are announced to the other gateway once more.
  std::vector<JournalEntry> left() {
    std::vector<JournalEntry> entries;
    journal_->connection_began();
    while (auto next = journal_->next_unanswered(BootTime{})) entries.push_back(std::move(*next));
    return entries;
  }
  JournalEntry kept(const std::string& id) {
    const auto found = store_->journal().find("press1", id);
    EXPECT_TRUE(found) << id;
    return found.value_or(JournalEntry{});
  }

  test::Scratch scratch_;
  StoreConfig config_;
  std::unique_ptr<StandbyJournal> journal_;
  std::unique_ptr<Store> store_;
};

struct StandbyJournalBegun : StandbyJournalTest {
  StandbyJournalBegun() { stand_by(); }
};

TEST_F(StandbyJournalBegun, AnnouncedCommandWaitsForItsResultAndCountsAsSent) {
  journal_->keep_announced(command("1"), kTopic);
  take_over_store();
  EXPECT_EQ(kept("1").result, "");
  EXPECT_FALSE(kept("1").acknowledged);
  EXPECT_FALSE(kept("1").surely_not_sent);
}

TEST_F(StandbyJournalBegun, ResultEndsItsCommand) {
  journal_->keep_announced(command("1"), kTopic);
  journal_->keep_result("press1", result("1", "SUCCEEDED"));
  take_over_store();
  EXPECT_EQ(kept("1").result, result("1", "SUCCEEDED"));
  EXPECT_TRUE(kept("1").acknowledged);
}

TEST_F(StandbyJournalBegun, ResultThatCameBeforeItsAnnouncementIsKept) {
  journal_->keep_result("press1", result("1", "SUCCEEDED"));
  journal_->keep_announced(command("1"), kTopic);
  take_over_store();
  EXPECT_EQ(kept("1").result, result("1", "SUCCEEDED"));
  EXPECT_TRUE(kept("1").acknowledged);
}

TEST_F(StandbyJournalBegun, FirstResultOfAnIdIsKept) {
  journal_->keep_announced(command("1"), kTopic);
  journal_->keep_result("press1", result("1", "DUPLICATE"));
  journal_->keep_result("press1", result("1", "FAILED"));
  journal_->keep_result("press1", result("1", "SUCCEEDED"));
  take_over_store();
  EXPECT_EQ(kept("1").result, result("1", "FAILED"));
}

TEST_F(StandbyJournalBegun, RefusedCommandHasNoAnnouncementAndIsKnown) {
  journal_->keep_result("press1", result("1", "REJECTED"));
  take_over_store();
  EXPECT_TRUE(kept("1").refused);
  EXPECT_TRUE(kept("1").acknowledged);
}

TEST_F(StandbyJournalBegun, ForeignTextsAreIgnored) {
  for (const char* text : {"", "{", "[]", R"({"id":"1"})"}) journal_->keep_result("press1", text);
  EXPECT_TRUE(take_over_store().journal().unacknowledged({}).empty());
  EXPECT_TRUE(store_->journal().known_ids({}).empty());
}

TEST_F(StandbyJournalBegun, OwnCommandsOfAnEarlierProcessAreAcknowledgedButReadsAreNot) {
  Store& earlier = take_over_store();
  JournalEntry write = command("w");
  JournalEntry read = command("r", "read");
  for (JournalEntry* each : {&write, &read}) {
    each->number = earlier.journal().next_command_number();
    audit::Receipt receipt;
    receipt.number = each->number;
    each->audit = audit::admitted(receipt, each->id, each->op, each->received_ms);
    ASSERT_TRUE(earlier.journal().journal({each, 1}));
  }
  earlier.close();
  store_.reset();
  stand_by();
  journal_->keep_announced(command("n"), kTopic);
  journal_->acknowledge_own_commands();
  take_over_store();
  EXPECT_TRUE(kept("w").acknowledged);
  EXPECT_FALSE(kept("r").acknowledged);
  EXPECT_FALSE(kept("n").acknowledged) << "the other gateway announced it";
}

TEST_F(StandbyJournalBegun, CommandThatTheOtherGatewayLeftKeepsItsResult) {
  JournalEntry done = command("done");
  done.result = result("done", "FAILED");
  JournalEntry unsent = command("unsent");
  unsent.surely_not_sent = true;
  JournalEntry sent = command("sent");
  for (const JournalEntry& each : {done, unsent, sent})
    EXPECT_FALSE(journal_->keep_unanswered(each, kTopic));
  EXPECT_EQ(journal_->keep_unanswered(command("done"), kTopic)->result, done.result);
  take_over_store();
  EXPECT_EQ(kept("done").result, done.result);
  std::map<std::string, bool> unanswered;
  for (const JournalEntry& each : store_->journal().unacknowledged({}))
    unanswered[each.id] = each.surely_not_sent;
  EXPECT_EQ(unanswered,
            (std::map<std::string, bool>{{"done", false}, {"sent", false}, {"unsent", true}}));
}

TEST_F(StandbyJournalBegun, WhatItLeftIsUnansweredUntilItHearsTheResult) {
  journal_->keep_announced(command("1"), kTopic);
  journal_->keep_announced(command("2"), kTopic);
  take_over_store().close();
  store_.reset();
  stand_by();
  journal_->keep_announced(command("of the other"), kTopic);
  journal_->keep_result("press1", result("1", "FAILED"));
  journal_->upkeep(SteadyTime{} + std::chrono::hours(1));
  ASSERT_EQ(left().size(), 1U);
  EXPECT_EQ(left()[0].id, "2");
}

TEST_F(StandbyJournalBegun, WhatHasNoReplyIsAnnouncedAgainAfterLongerAndLongerPauses) {
  journal_->keep_announced(command("1"), kTopic);
  take_over_store().close();
  store_.reset();
  stand_by();
  std::vector<int> at;
  journal_->connection_began();
  for (int s = 0; s < 200; ++s)
    if (journal_->next_unanswered(BootTime(std::chrono::seconds(s)))) at.push_back(s);
  EXPECT_EQ(at, (std::vector<int>{0, 5, 15, 35, 75, 135, 195}));
  journal_->connection_began();
  EXPECT_TRUE(journal_->next_unanswered(BootTime(std::chrono::seconds(201))));
  journal_->keep_result("press1", result("1", "FAILED"));
  EXPECT_FALSE(journal_->next_unanswered(BootTime(std::chrono::hours(1))));
}

TEST_F(StandbyJournalBegun, NextProcessKeepsWhatThisOneSaved) {
  journal_->keep_announced(command("known"), kTopic);
  take_over_store().close();
  store_.reset();
  const auto save = [&](const JournalEntry& entry) {
    return StandbyJournal::save_heard(config_, kTopic,
                                      pair_messages::announcement({.boot = "b", .entry = entry}));
  };
  JournalEntry old = command("old");
  old.received_ms -= std::chrono::milliseconds(kRememberedFor).count();
  EXPECT_TRUE(save(command("known")));
  EXPECT_TRUE(StandbyJournal::save_heard(config_, kTopic, "{\"cut off"));
  EXPECT_TRUE(save(command("saved")));
  EXPECT_TRUE(save(command("done")));
  EXPECT_TRUE(save(old));
  EXPECT_TRUE(StandbyJournal::save_heard(config_, "press1", result("done", "SUCCEEDED")));
  for (int run = 0; run < 2; ++run) {
    stand_by();
    const auto unanswered = left();
    ASSERT_EQ(unanswered.size(), 2U);
    EXPECT_EQ(unanswered[1].id, "saved");
    EXPECT_FALSE(unanswered[1].surely_not_sent);
    journal_->close();
  }
  take_over_store();
  EXPECT_EQ(kept("done").result, result("done", "SUCCEEDED"));
  EXPECT_FALSE(store_->journal().find("press1", "old"));
}

TEST_F(StandbyJournalTest, WhatCannotBeSavedIsReported) {
  config_.path = scratch_.path("nothing/here");
  EXPECT_FALSE(StandbyJournal::save_heard(config_, kTopic, "{}"));
}

// Its sender has sent it again, and the other gateway carries it out: no proof of before is left.
TEST_F(StandbyJournalBegun, UnsentCommandThatTheOtherGatewayAnnouncesCountsAsSent) {
  JournalEntry unsent = command("1");
  unsent.surely_not_sent = true;
  journal_->keep_unanswered(unsent, kTopic);
  take_over_store().close();
  store_.reset();
  stand_by();
  ASSERT_TRUE(left().at(0).surely_not_sent);
  journal_->keep_announced(command("1"), kTopic);
  EXPECT_TRUE(left().empty());
  take_over_store();
  ASSERT_EQ(store_->journal().unacknowledged({}).size(), 1U);
  EXPECT_FALSE(store_->journal().unacknowledged({})[0].surely_not_sent);
}

TEST_F(StandbyJournalBegun, CommandThatTheOtherGatewayMayHaveForgottenIsNotUnanswered) {
  JournalEntry old = command("1");
  old.received_ms -= std::chrono::milliseconds(kRememberedFor).count();
  journal_->keep_unanswered(old, kTopic);
  journal_->keep_unanswered(command("2"), kTopic);
  take_over_store().close();
  store_.reset();
  stand_by();
  ASSERT_EQ(left().size(), 1U);
  EXPECT_EQ(left()[0].id, "2");
}

TEST_F(StandbyJournalBegun, TakenOverEntryGetsANumberOfTheOtherStore) {
  Store& store = take_over_store();
  std::vector<JournalEntry> entries{command("open"), command("done")};
  entries[1].result = result("done", "SUCCEEDED");
  entries[1].acknowledged = true;
  take_over(entries, store);
  EXPECT_LT(0U, entries[0].number);
  EXPECT_LT(entries[0].number, entries[1].number);
  store.close();
  open_store();
  EXPECT_EQ(kept("open").result, "");
  EXPECT_EQ(kept("done").result, entries[1].result);
  EXPECT_TRUE(kept("done").acknowledged);
}

TEST_F(StandbyJournalTest, CommandThatAFullDiskRefusedIsUnanswered) {
  open_store();
  store_.reset();
  {
    UnrecordedFile file(config_.path);
    file.open();
    file.keep(command("1"));
    JournalEntry over = command("2");
    over.acknowledged = true;
    file.keep(over);
  }
  stand_by();
  journal_->upkeep(SteadyTime{} + std::chrono::hours(1));
  const auto entries = left();
  ASSERT_EQ(entries.size(), 1U);
  EXPECT_EQ(entries[0].id, "1");
}

}  // namespace
}  // namespace fxagent
