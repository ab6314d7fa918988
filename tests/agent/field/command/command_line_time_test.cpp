#include "agent/field/command/command_line_time.h"

#include <gtest/gtest.h>

#include "tests/agent/field/command/command_plant.h"

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
  AdmittedCommand admitted(Op op, std::vector<CommandTarget> targets) {
    Command command = command_of("b7e1", op, std::move(targets));
    command.is_list = command.targets.size() > 1;
    CommandAdmission admission(device);
    return test::admitted(admission, std::move(command), device.codec);
  }
  AdmittedCommand reading(std::string name) {
    return admitted(Op::read, {target_of(std::move(name))});
  }
  AdmittedCommand list() {
    const Value ones = Value::array(Scalars(50, Scalar(std::int64_t{1})));
    return admitted(Op::write, {target_of("setpoint", number(50)), target_of("recipe", ones)});
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
    const nanoseconds time =
        time_of(admitted(Op::write, {target_of("name", text(std::move(value)))}), milliseconds(1));
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
  AdmittedCommand command = admitted(Op::run, {});
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
