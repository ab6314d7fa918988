#include "agent/field/command/command_line_time.h"

#include <gtest/gtest.h>

#include "agent/commands/admission.h"
#include "tests/agent/field/field_plant.h"

namespace fxagent::test {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;
using std::chrono::seconds;

/// A writable word and a writable array of 50.
struct CommandLineTime : ::testing::Test {
  CommandLineTime() {
    device.tags.push_back(writable(tag(*device.codec, "setpoint", "D200")));
    device.tags.push_back(writable(array_of(tag(*device.codec, "recipe", "D300"), 50)));
    device.commands.allow_run_stop = true;
  }
  AdmittedCommand admitted(Command command) {
    command.id = "b7e1";
    command.received = std::chrono::steady_clock::now();
    CommandAdmission admission(device);
    auto decision = admission.admit(std::move(command), device.codec, 0, command.received);
    if (const auto* refused = std::get_if<CommandResult>(&decision)) {
      ADD_FAILURE() << refused->detail;
      return {};
    }
    return std::get<AdmittedCommand>(std::move(decision));
  }
  AdmittedCommand reading(std::string name) {
    Command command;
    command.op = Op::read;
    command.targets.push_back({std::move(name), "", std::nullopt, std::nullopt});
    return admitted(std::move(command));
  }
  AdmittedCommand list() {
    Command command;
    command.op = Op::write;
    command.is_list = true;
    command.targets.push_back({"setpoint", "", std::nullopt, number(50)});
    command.targets.push_back(
        {"recipe", "", std::nullopt, Value::array(Scalars(50, Scalar(std::int64_t{1})))});
    return admitted(std::move(command));
  }
  nanoseconds time_of(AdmittedCommand command, milliseconds character) {
    return set_line_times(*device.codec, device, {}, character, command);
  }

  DeviceConfig device = port_device();
};

TEST_F(CommandLineTime, IsThatOfAllTargets) {
  AdmittedCommand both = list();
  set_line_times(*device.codec, device, {}, milliseconds(1), both);
  ASSERT_EQ(both.targets.size(), 2U);
  EXPECT_GT(both.targets[0].line_time, nanoseconds(0));
  EXPECT_GT(both.targets[1].line_time, both.targets[0].line_time);
  EXPECT_EQ(both.line_time, both.targets[0].line_time + both.targets[1].line_time);
  EXPECT_EQ(time_of(both, milliseconds(1)), both.line_time);
}

TEST_F(CommandLineTime, CountsTheReadBeforeAStringOfOddLength) {
  const auto time_of_length = [&](std::uint16_t length, std::string value) {
    device.tags.push_back(writable(tag(*device.codec, "name", "D400", DataType::string)));
    device.tags.back().point.length = length;
    Command command;
    command.op = Op::write;
    command.targets.push_back({"name", "", std::nullopt, text(std::move(value))});
    const nanoseconds time = time_of(admitted(std::move(command)), milliseconds(1));
    device.tags.pop_back();
    return time;
  };
  EXPECT_GT(time_of_length(3, "abc"), time_of_length(4, "abcd"));
}

TEST_F(CommandLineTime, IsNotKnownOnALineOfUnknownSpeed) {
  AdmittedCommand read = reading("setpoint");
  set_line_times(*device.codec, device, {}, milliseconds(0), read);
  EXPECT_FALSE(read.line_time);
}

TEST_F(CommandLineTime, RunCountsTheQuestionsAboutItsEffectOnceAndInTheBoundForTwoSeconds) {
  Command run;
  run.op = Op::run;
  AdmittedCommand command = admitted(std::move(run));
  set_line_times(*device.codec, device, {}, milliseconds(1), command);
  ASSERT_TRUE(command.line_time);
  EXPECT_EQ(time_of(command, milliseconds(1)), *command.line_time + seconds(2));
}

TEST_F(CommandLineTime, OnlyListsAndLongArraysGiveWay) {
  AdmittedCommand word = reading("setpoint");
  set_line_times(*device.codec, device, {}, milliseconds(1), word);
  EXPECT_FALSE(gives_way(word));
  EXPECT_TRUE(gives_way(list()));
  AdmittedCommand array = reading("recipe");
  set_line_times(*device.codec, device, {}, milliseconds(1), array);
  EXPECT_FALSE(gives_way(array)) << "it takes less than 2 s";
  set_line_times(*device.codec, device, {}, milliseconds(20), array);
  EXPECT_TRUE(gives_way(array));
  EXPECT_TRUE(gives_way(array.targets[0]));
}

TEST_F(CommandLineTime, BitsAndWordsAreReadBackEachByTheirOwnRule) {
  AdmittedCommand command;
  command.verify_words = true;
  AdmittedTarget bit;
  bit.point.type = DataType::boolean;
  AdmittedTarget word;
  word.point.type = DataType::int16;
  EXPECT_FALSE(is_verified(command, bit));
  EXPECT_TRUE(is_verified(command, word));
}

}  // namespace
}  // namespace fxagent::test
