#include "agent/cli/audit/command_line_audit.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "agent/commands/result.h"
#include "agent/store/journal/unrecorded_file.h"
#include "agent/store/store.h"
#include "tests/agent/store/shelf.h"

namespace fxagent {
namespace {

using nlohmann::json;

constexpr std::int64_t kNow = 1790000000000;

struct CommandLineAuditTest : ::testing::Test {
  CommandLineAuditTest() {
    config.path = scratch.path("store");
    command.id = "command-line";
    command.op = Op::write;
    command.op_text = "write";
    command.received_ms = kNow;
  }

  CommandResult result_with(CommandStatus status) const {
    CommandResult result = result_of(command);
    result.status = status;
    return result;
  }
  /// Returns the records of the file as `fxagent audit` reads them. Expects an intact chain.
  std::vector<json> records() const {
    std::vector<json> all;
    for (const std::string& text : test::audit_of(store_file_path(config.path)))
      all.push_back(json::parse(text));
    return all;
  }

  test::Scratch scratch;
  StoreConfig config;
  Command command;
};

TEST_F(CommandLineAuditTest, CommandIsOnDiskBeforeItIsSentAndItsResultAfterIt) {
  CommandLineAudit audit(config, kNow, "press1", "write press1 D100 5");
  ASSERT_EQ(audit.fault(), "");
  ASSERT_TRUE(audit.admitted(command));
  ASSERT_EQ(records().size(), 1U);
  EXPECT_EQ(records()[0]["kind"], "ordered");
  const auto by = records()[0]["by"].get<std::string>();
  EXPECT_EQ(by.substr(0, 4), "cli:");
  EXPECT_GT(by.size(), 4U);
  EXPECT_EQ(records()[0]["topic"], "command line");
  EXPECT_EQ(records()[0]["payload"], "write press1 D100 5");
  ASSERT_TRUE(audit.finished(result_with(CommandStatus::succeeded), kNow + 5));
  ASSERT_EQ(records().size(), 2U);
  EXPECT_EQ(records()[1]["kind"], "result");
  EXPECT_EQ(records()[1]["arrival"], records()[0]["arrival"]);
  EXPECT_EQ(records()[1]["result"]["status"], "SUCCEEDED");
}

TEST_F(CommandLineAuditTest, CommandThatIsRefusedIsThereToo) {
  CommandLineAudit audit(config, kNow, "press1", "write press1 D100 5");
  ASSERT_TRUE(audit.refused(command, result_with(CommandStatus::rejected)));
  ASSERT_EQ(records().size(), 1U);
  EXPECT_EQ(records()[0]["kind"], "answered");
  EXPECT_EQ(records()[0]["result"]["status"], "REJECTED");
}

TEST_F(CommandLineAuditTest, AgentGoesOnWithTheChainAndTheNumbers) {
  std::uint64_t before = 0;
  {
    Store agent(config, kNow);
    before = agent.audit().next_command_number();
    agent.journal().note(audit::begun("", kNow));
    agent.close();
  }
  {
    CommandLineAudit audit(config, kNow, "press1", "write press1 D100 5");
    ASSERT_TRUE(audit.admitted(command));
  }
  EXPECT_EQ(records().back()["arrival"], before + 1);
  Store agent(config, kNow);
  EXPECT_EQ(agent.state(), "disk");
  EXPECT_EQ(agent.set_aside(), "");
  EXPECT_EQ(agent.audit().next_command_number(), before + 2);
  agent.journal().note(audit::begun("", kNow));
  agent.close();
  EXPECT_EQ(records().size(), 3U);
}

TEST_F(CommandLineAuditTest, NumberOfACommandThatTheDiskRefusedIsNotTakenAgain) {
  Store(config, kNow).close();
  JournalEntry refused;
  refused.number = 57;
  refused.device = "press1";
  refused.id = "b7e1";
  UnrecordedFile file(config.path);
  file.open();
  file.keep(refused);
  CommandLineAudit audit(config, kNow, "press1", "write press1 D100 5");
  ASSERT_TRUE(audit.admitted(command));
  EXPECT_EQ(records().back()["arrival"], 58);
}

TEST_F(CommandLineAuditTest, StoreOfAnAgentThatRunsTakesNothing) {
  Store agent(config, kNow);
  testing::internal::CaptureStderr();
  CommandLineAudit audit(config, kNow, "press1", "write press1 D100 5");
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "") << "the agent's store has no fault";
  EXPECT_NE(audit.fault().find("is in use by a running agent"), std::string::npos) << audit.fault();
  EXPECT_TRUE(audit.fault().ends_with(
      ": send the command over MQTT or from the page, or stop the agent first"))
      << audit.fault();
  EXPECT_EQ(audit.fault().find("its own directory"), std::string::npos) << audit.fault();
  EXPECT_FALSE(audit.admitted(command));
  EXPECT_TRUE(records().empty());
}

}  // namespace
}  // namespace fxagent
