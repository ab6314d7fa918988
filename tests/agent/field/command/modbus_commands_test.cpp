// Commands on protocols with features that the programming port lacks: refusals with reasons,
// broadcasts, several writes in one frame. The frames come from the specifications.
#include <gtest/gtest.h>

#include "tests/agent/field/command/command_plant.h"
#include "tests/agent/field/port_frames.h"

namespace fxagent::test {
namespace {

Bytes hex(std::string_view text) { return *from_hex(text); }

struct CommandOnTheBusTest : CommandBusTest {
  void use(std::string_view protocol, std::shared_ptr<const Codec> codec) {
    device = device_on(protocol, std::move(codec));
    station.codec = device.codec;
    make_bus();
  }
  void use_writable(std::string name, std::string_view address) {
    device.tags.push_back(writable(tag(*device.codec, std::move(name), address)));
  }
  void use_modbus(bool read_modify_write = false) {
    use("modbus-tcp", codec_of("modbus-tcp", {{"allow_read_modify_write", read_modify_write}}));
    use_writable("setpoint", "hr:10");
    use_writable("enable", "hr:10.3");
    use_writable("lamp", "co:5");
  }

  /// All units of a line, of which none answers.
  void use_all_units() {
    use("modbus-rtu", codec_of("modbus-rtu", {{"unit", std::int64_t{0}}}));
    use_writable("setpoint", "hr:1");
  }
  void use_computer_link() {
    use("fx-computer-link", codec_of("fx-computer-link", {{"station", std::int64_t{5}},
                                                          {"model", std::string("FX2N")}}));
    station.enquire = EnquirePolicy::never;
  }

  CommandResult write(std::string tag, Value value) {
    return run(Op::write, {target_of(std::move(tag), std::move(value))});
  }
  CommandResult read(std::string tag) { return run(Op::read, {target_of(std::move(tag))}); }
  using CommandBusTest::run;
  /// Several targets are a list.
  CommandResult run(Op op, std::vector<CommandTarget> targets) {
    Command command = command_of("b7e1", op, std::move(targets));
    command.is_list = command.targets.size() > 1;
    command.verify = false;
    command.received_ms = 1790000000000;
    CommandAdmission admission(device);
    return run(admitted(admission, std::move(command), device.codec));
  }
};

/// A frame of the computer link: a control character and text.
Bytes link_frame(const Bytes& control, std::string_view text) {
  return joined(control, Bytes(text.begin(), text.end()));
}

struct CommandModbusOnTheBusTest : CommandOnTheBusTest {
  CommandModbusOnTheBusTest() { use_modbus(); }
};

TEST_F(CommandModbusOnTheBusTest, FunctionThatTheDeviceLacksIsReplacedByAnother) {
  wire->expect(hex("0001 0000 0006 01 06 000A 0032")).give(hex("0001 0000 0003 01 86 01"));
  wire->expect(hex("0002 0000 0009 01 10 000A 0001 02 0032"))
      .give(hex("0002 0000 0006 01 10 000A 0001"));
  const CommandResult result = write("setpoint", number(50));
  EXPECT_EQ(result.status, CommandStatus::succeeded);
  EXPECT_EQ(result.attempts, 2);
}

TEST_F(CommandModbusOnTheBusTest, CoilGoesByFifteenWhereFiveIsMissing) {
  wire->expect(hex("0001 0000 0006 01 05 0005 FF00")).give(hex("0001 0000 0003 01 85 01"));
  wire->expect(hex("0002 0000 0008 01 0F 0005 0001 01 01"))
      .give(hex("0002 0000 0006 01 0F 0005 0001"));
  EXPECT_EQ(write("lamp", flag(true)).status, CommandStatus::succeeded);
}

TEST_F(CommandOnTheBusTest, BitOfARegisterIsReadChangedAndWrittenWhereThatIsAllowed) {
  use_modbus(true);
  wire->expect(hex("0001 0000 0008 01 16 000A FFF7 0008")).give(hex("0001 0000 0003 01 96 01"));
  wire->expect(hex("0002 0000 0006 01 03 000A 0001")).give(hex("0002 0000 0005 01 03 02 8001"));
  wire->expect(hex("0003 0000 0006 01 06 000A 8009")).give(hex("0003 0000 0006 01 06 000A 8009"));
  const CommandResult result = write("enable", flag(true));
  EXPECT_EQ(result.status, CommandStatus::succeeded);
  EXPECT_EQ(result.attempts, 2);
}

TEST_F(CommandModbusOnTheBusTest, BitOfARegisterIsNotReadAndWrittenWhereThatIsNotAllowed) {
  wire->expect(hex("0001 0000 0008 01 16 000A FFF7 0000")).give(hex("0001 0000 0003 01 96 01"));
  const CommandResult result = write("enable", flag(false));
  EXPECT_EQ(ending(result), "FAILED nak");
  EXPECT_EQ(result.plc, PlcAnswer::nak);
  EXPECT_EQ(result.detail,
            "exception 01: illegal function; with allow_read_modify_write the agent reads and "
            "writes the whole register");
  EXPECT_EQ(result.attempts, 1);
}

TEST_F(CommandOnTheBusTest, ReadThatMustComeFirstAndFailsLeavesTheRegisterAlone) {
  use_modbus(true);
  wire->expect(hex("0001 0000 0008 01 16 000A FFF7 0008")).give(hex("0001 0000 0003 01 96 01"));
  wire->expect(hex("0002 0000 0006 01 03 000A 0001")).give(hex("0002 0000 0003 01 83 02"));
  const CommandResult result = write("enable", flag(true));
  EXPECT_EQ(result.status, CommandStatus::failed);
  EXPECT_EQ(result.attempts, 1);
}

TEST_F(CommandModbusOnTheBusTest, BusyDeviceIsAskedOnceMore) {
  const Bytes again = hex("0002 0000 0006 01 06 000A 0032");
  wire->expect(hex("0001 0000 0006 01 06 000A 0032")).give(hex("0001 0000 0003 01 86 06"));
  wire->expect(again).give(again);
  const CommandResult result = write("setpoint", number(50));
  EXPECT_EQ(result.status, CommandStatus::succeeded);
  EXPECT_EQ(result.attempts, 2);
  EXPECT_GE(result.wire, std::chrono::milliseconds(100)) << "it says itself that it has no time";
}

TEST_F(CommandModbusOnTheBusTest, BusyDeviceIsReadOnceMore) {
  wire->expect(hex("0001 0000 0006 01 03 000A 0001")).give(hex("0001 0000 0003 01 83 06"));
  wire->expect(hex("0002 0000 0006 01 03 000A 0001")).give(hex("0002 0000 0005 01 03 02 0032"));
  const CommandResult result = read("setpoint");
  EXPECT_EQ(result.status, CommandStatus::succeeded);
  EXPECT_GE(result.wire, std::chrono::milliseconds(100)) << "it says itself that it has no time";
}

TEST_F(CommandModbusOnTheBusTest, LongReadGoesInThePartsThatPollsHaveFound) {
  const TagConfig list = array_of(tag(*device.codec, "list", "hr:0"), 3);
  device.tags.push_back(list);
  limits.push_back({list.point.address.span.space, 32});
  wire->expect(hex("0001 0000 0006 01 03 0000 0001")).give(hex("0001 0000 0005 01 03 02 0001"));
  wire->expect(hex("0002 0000 0006 01 03 0001 0002"))
      .give(hex("0002 0000 0007 01 03 04 0002 0003"));
  const CommandResult result = read("list");
  EXPECT_EQ(ending(result), "SUCCEEDED");
  EXPECT_EQ(result.targets.at(0).value, numbers({1, 2, 3}));
}

TEST_F(CommandOnTheBusTest, RefusalThatLeavesTheEffectOpenIsSettledByReadingBack) {
  for (const char* code : {"04", "05", "0B", "7F"}) {
    use_modbus();
    wire->expect(hex("0001 0000 0006 01 06 000A 0032"))
        .give(hex(std::string("0001 0000 0003 01 86 ") + code));
    wire->expect(hex("0002 0000 0006 01 03 000A 0001")).give(hex("0002 0000 0005 01 03 02 0032"));
    const CommandResult result = write("setpoint", number(50));
    EXPECT_EQ(result.status, CommandStatus::succeeded) << code;
    EXPECT_EQ(result.plc, PlcAnswer::none);
    EXPECT_TRUE(result.targets[0].verify && result.targets[0].verify->match);
    EXPECT_EQ(result.attempts, 1) << "never a second time";
    EXPECT_TRUE(result.detail.starts_with("a refusal ")) << result.detail;
  }
}

TEST_F(CommandModbusOnTheBusTest, RefusalThatLeavesTheEffectOpenIsUnknownWhereTheValueIsAnother) {
  wire->expect(hex("0001 0000 0006 01 06 000A 0032")).give(hex("0001 0000 0003 01 86 05"));
  wire->expect(hex("0002 0000 0006 01 03 000A 0001")).give(hex("0002 0000 0005 01 03 02 0000"));
  const CommandResult result = write("setpoint", number(50));
  EXPECT_EQ(result.status, CommandStatus::unknown_outcome);
  EXPECT_NE(result.detail.find("exception 05"), std::string::npos) << result.detail;
}

TEST_F(CommandModbusOnTheBusTest, GatewayWithoutAPathToTheUnitHasNotSentIt) {
  wire->expect(hex("0001 0000 0006 01 06 000A 0032")).give(hex("0001 0000 0003 01 86 0A"));
  const CommandResult result = write("setpoint", number(50));
  EXPECT_EQ(result.status, CommandStatus::failed);
  EXPECT_EQ(result.plc, PlcAnswer::nak);
  EXPECT_FALSE(was_answered) << "the gateway answered, not the device";
}

TEST_F(CommandModbusOnTheBusTest, HeaderOfNonsenseEndsTheConnectionAndTheReadBackOpensAnother) {
  wire->expect(hex("0001 0000 0006 01 06 000A 0032")).give(hex("0001 0000 0384 01"));
  wire->expect(hex("0002 0000 0006 01 03 000A 0001")).give(hex("0002 0000 0005 01 03 02 0032"));
  const CommandResult result = write("setpoint", number(50));
  EXPECT_EQ(result.status, CommandStatus::succeeded);
  EXPECT_EQ(wire->opened(), 2U);
}

TEST_F(CommandModbusOnTheBusTest, LateAnswerOnTcpIsToldByItsNumber) {
  wire->expect(hex("0001 0000 0006 01 06 000A 0032")).silence();
  wire->expect(hex("0002 0000 0006 01 03 000A 0001"))
      .give(hex("0001 0000 0006 01 06 000A 0032 0002 0000 0005 01 03 02 0000"));
  const CommandResult result = write("setpoint", number(50));
  EXPECT_EQ(result.status, CommandStatus::unknown_outcome) << "the PLC holds another value";
}

TEST_F(CommandOnTheBusTest, NobodyAnswersABroadcast) {
  use_all_units();
  // Serial Line V1.02: unit 0, function 06.
  wire->expect(hex("00 06 00 01 00 AA 59 A4"));
  const CommandResult result = write("setpoint", number(0xAA));
  EXPECT_EQ(ending(result), "UNKNOWN_OUTCOME broadcast");
  EXPECT_EQ(result.plc, PlcAnswer::none);
  CommandAdmission admission(device);
  const SteadyTime now = std::chrono::steady_clock::now();
  Command read = command_of("r", Op::read, {target_of("setpoint")});
  read.received = now;
  const auto decision = admission.admit(std::move(read), device.codec, 0, now);
  ASSERT_TRUE(std::holds_alternative<CommandResult>(decision));
  EXPECT_EQ(std::get<CommandResult>(decision).reason, Reason::unknown_tag);
}

TEST_F(CommandOnTheBusTest, ListForAllUnitsIsSentToItsEnd) {
  use_all_units();
  wire->expect(hex("00 06 00 01 00 AA 59 A4"));
  wire->expect(hex("00 06 00 01 00 AA 59 A4"));
  const CommandTarget target = target_of("setpoint", number(0xAA));
  const CommandResult result = run(Op::write, {target, target});
  EXPECT_EQ(ending(result), "UNKNOWN_OUTCOME broadcast");
  EXPECT_EQ(result.targets.at(1).reason, Reason::broadcast);
  EXPECT_EQ(result.attempts, 2);
}

// JY992D69901 8.6: three words in one frame; the sum as printed.
TEST_F(CommandOnTheBusTest, ListGoesInOneFrameWhereTheProtocolHasOne) {
  use_computer_link();
  use_writable("a", "D500");
  use_writable("b", "K4Y100");
  use_writable("c", "CN100");
  wire->expect(link_frame(kEnq, "05FFWT003D05001234Y0100BCA9CN100006407"))
      .give(link_frame(kAck, "05FF"));
  const CommandResult result =
      run(Op::write, {target_of("a", number(0x1234)), target_of("b", number(0xBCA9 - 0x10000)),
                      target_of("c", number(100))});
  EXPECT_EQ(result.status, CommandStatus::succeeded);
  EXPECT_TRUE(result.one_frame);
  EXPECT_EQ(result.attempts, 1);
  EXPECT_EQ(result.targets.size(), 3U);
}

TEST_F(CommandOnTheBusTest, ListThatIsNotSentWentInNoFrame) {
  use_computer_link();
  use_writable("a", "D500");
  use_writable("b", "D600");
  Command command =
      command_of("b7e1", Op::write, {target_of("a", number(1)), target_of("b", number(2))});
  command.is_list = true;
  CommandAdmission admission(device);
  AdmittedCommand late = admitted(admission, std::move(command), device.codec);
  late.deadline = {};
  const CommandResult result = run(late);
  EXPECT_EQ(ending(result), "EXPIRED expired");
  EXPECT_FALSE(result.one_frame);
}

TEST_F(CommandOnTheBusTest, StopThatIsRefusedForAnUnknownReasonMayHaveBeenCarriedOut) {
  use("mc-3e", codec_of("mc-3e", {{"model", std::string("FX5U")}}));
  device.commands.allow_run_stop = true;
  wire->then([](ByteView) { return hex("D000 00 FF FF03 00 0B00 5555 00 FF FF03 00 0210 0000"); });
  const CommandResult result = run(Op::stop, {});
  EXPECT_EQ(ending(result), "UNKNOWN_OUTCOME nak");
  EXPECT_EQ(result.plc, PlcAnswer::none);
  EXPECT_NE(result.detail.find("end code 5555"), std::string::npos) << result.detail;
}

// In one frame, the order of two writes to one place would be the PLC's.
TEST_F(CommandOnTheBusTest, TargetsThatOverlapAreSentOneAfterTheOther) {
  use_computer_link();
  use_writable("a", "D500");
  use_writable("again", "D500");
  const Bytes ack = link_frame(kAck, "05FF");
  wire->expect(link_frame(kEnq, "05FFWW0D0500010001FA")).give(ack);
  wire->expect(link_frame(kEnq, "05FFWW0D0500010002FB")).give(ack);
  const CommandResult result =
      run(Op::write, {target_of("a", number(1)), target_of("again", number(2))});
  EXPECT_EQ(result.status, CommandStatus::succeeded);
  EXPECT_FALSE(result.one_frame);
  EXPECT_EQ(result.attempts, 2);
}

}  // namespace
}  // namespace fxagent::test
