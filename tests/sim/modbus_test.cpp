#include "tests/sim/modbus.h"

#include <gtest/gtest.h>

#include "tests/sim/sample_plc.h"
#include "tests/sim/transcripts.h"

namespace fxsim {
namespace {

using std::chrono::milliseconds;

constexpr unsigned kLast = 0xFFFF;

Plc make_device(std::string_view plant = "none") {
  return {modbus_model(), make_plant(plant), TimePoint{}};
}

/// Builds an RTU frame from `content` (unit and PDU).
Bytes rtu(std::string_view content) {
  const auto bytes = hex(content);
  return wrap_modbus(Protocol::modbus_rtu, {bytes[0], Bytes(bytes.begin() + 1, bytes.end())}, {});
}

Protocol protocol_of(const test::Exchange& e) { return find_protocol("modbus-" + e.model).value(); }

/// "17.0" is unit and transaction.
std::uint8_t unit_of(const test::Exchange& e) {
  return static_cast<std::uint8_t>(std::stoul(e.command_set));
}

/// The holes of libmodbus's unit test server.
std::vector<ModbusSettings::Hole> holes_of_libmodbus() {
  return {{Kind::coil, {0, 0x12F}},
          {Kind::coil, {0x155, kLast}},
          {Kind::discrete_input, {0, 0x1C3}},
          {Kind::discrete_input, {0x1DA, kLast}},
          {Kind::holding_register, {0, 0x15F}},
          {Kind::holding_register, {0x180, kLast}},
          {Kind::input_register, {0, 0x107}},
          {Kind::input_register, {0x109, kLast}}};
}

class ModbusDevice : public testing::Test {
 protected:
  explicit ModbusDevice(ModbusSettings settings = {}) : settings_(std::move(settings)) {}

  /// Returns the PDU of the reply to an RTU request given as unit and PDU; "" if there is no reply.
  std::string asked(std::string_view content) {
    const auto device = make_modbus(Protocol::modbus_rtu, settings_);
    const auto reply = replies_of(*device, plc_, rtu(content));
    if (reply.empty()) return "";
    return to_hex(ByteView(reply).subspan(1, reply.size() - 3));
  }

  ModbusSettings settings_;
  Plc plc_ = make_device();
};

TEST(ModbusFrames, OfTheTranscriptsAreAnswered) {
  for (const auto& e : simulated("modbus.txt")) {
    SCOPED_TRACE(e.where());
    ModbusSettings settings;
    settings.unit = unit_of(e);
    // The device of the specification's exception lacks this coil.
    if (e.device == "co:1185") settings.holes = {{Kind::coil, {1185, 1185}}};
    if (e.source.starts_with("captured")) settings.holes = holes_of_libmodbus();
    const auto device = make_modbus(protocol_of(e), settings);
    if (e.simulated == "refusal")
      EXPECT_EQ(to_hex(device->refusal({e.request, true, {}}, e.image[0])), to_hex(e.reply));
    else
      expect_exchange(e, *device, make_device());
  }
}

TEST_F(ModbusDevice, LargestRequestsAreCarriedOutAndOneMoreIsNot) {
  EXPECT_EQ(asked("01 03 00 00 00 7D").substr(0, 5), "03 FA");
  EXPECT_EQ(asked("01 03 00 00 00 7E"), "83 03");
  EXPECT_EQ(asked("01 01 00 00 07 D0").substr(0, 5), "01 FA");
  EXPECT_EQ(asked("01 01 00 00 07 D1"), "81 03");
  EXPECT_EQ(asked("01 10 00 00 00 7B F6" + zeros(246)), "10 00 00 00 7B");
  EXPECT_EQ(asked("01 10 00 00 00 7C 02" + zeros(2)), "90 03");
  EXPECT_EQ(asked("01 0F 00 00 07 B0 F6" + zeros(246)), "0F 00 00 07 B0");
  EXPECT_EQ(asked("01 17 00 00 00 01 00 00 00 79 F2" + zeros(242)).substr(0, 5), "17 02");
}

TEST_F(ModbusDevice, AllAddressesExistAndNoneBehindThem) {
  EXPECT_EQ(asked("01 03 FF FF 00 01"), "03 02 00 00");
  EXPECT_EQ(asked("01 03 FF FF 00 02"), "83 02");
  EXPECT_EQ(asked("01 0F FF F8 00 09 02 00 00"), "8F 02");
}

TEST_F(ModbusDevice, TablesAreFour) {
  preset(plc_, "co:5=1; di:6=1; hr:5=1111; ir:5=2222");
  EXPECT_EQ(asked("01 01 00 00 00 08"), "01 01 20");
  EXPECT_EQ(asked("01 02 00 00 00 08"), "02 01 40");
  EXPECT_EQ(asked("01 03 00 05 00 01"), "03 02 11 11");
  EXPECT_EQ(asked("01 04 00 05 00 01"), "04 02 22 22");
}

TEST_F(ModbusDevice, CoilTakesOnlyItsTwoValues) {
  EXPECT_EQ(asked("01 05 00 03 FF 00"), "05 00 03 FF 00");
  EXPECT_EQ(asked("01 05 00 03 00 01"), "85 03");
  EXPECT_EQ(differences(plc_, "co:3=1"), "");
  EXPECT_EQ(asked("01 05 00 03 00 00"), "05 00 03 00 00");
  EXPECT_EQ(differences(plc_, "co:3=0"), "");
}

TEST_F(ModbusDevice, WriteComesBeforeTheReadOfTheSameRequest) {
  preset(plc_, "hr:10=1 2 3");
  EXPECT_EQ(asked("01 17 00 0A 00 03 00 0B 00 01 02 00 FF"), "17 06 00 01 00 FF 00 03");
}

TEST_F(ModbusDevice, FunctionsItLacksGetExceptionOne) {
  EXPECT_EQ(asked("01 07"), "87 01");
  EXPECT_EQ(asked("01 08 00 00 12 34"), "88 01");
  EXPECT_EQ(asked("01 0B"), "8B 01");
  EXPECT_EQ(asked("01 11"), "91 01");
  EXPECT_EQ(asked("01 2B 0E 01 00"), "AB 01");
  settings_.missing_functions = {6, 22};
  EXPECT_EQ(asked("01 06 00 01 00 02"), "86 01");
  EXPECT_EQ(asked("01 16 00 01 00 00 00 02"), "96 01");
  EXPECT_EQ(asked("01 10 00 01 00 01 02 00 02"), "10 00 01 00 01");
  EXPECT_EQ(differences(plc_, "hr:1=2"), "");
}

TEST_F(ModbusDevice, SaysWhoMadeIt) {
  settings_.identity = {"Maker", "P1"};
  EXPECT_EQ(asked("01 2B 0E 01 00"), "2B 0E 01 01 00 00 02 00 05 4D 61 6B 65 72 01 02 50 31");
  EXPECT_EQ(asked("01 2B 0E 04 00"), "AB 01");
}

TEST_F(ModbusDevice, RequestThatTouchesAHoleGetsExceptionTwo) {
  settings_.holes = {{Kind::holding_register, {100, 119}}};
  EXPECT_EQ(asked("01 03 00 60 00 04"), "03 08 00 00 00 00 00 00 00 00");  // 96 to 99
  EXPECT_EQ(asked("01 03 00 60 00 05"), "83 02");
  EXPECT_EQ(asked("01 03 00 77 00 02"), "83 02");
  EXPECT_EQ(asked("01 03 00 78 00 01"), "03 02 00 00");
  EXPECT_EQ(asked("01 06 00 64 00 01"), "86 02");
  EXPECT_EQ(asked("01 04 00 64 00 01"), "04 02 00 00");
  EXPECT_EQ(asked("01 17 00 00 00 01 00 64 00 01 02 00 01"), "97 02");
  EXPECT_EQ(differences(plc_, "hr:100=0"), "");
}

TEST_F(ModbusDevice, LongerReadsThanItTakesGetTheCodeItSays) {
  settings_.max_read = 50;
  EXPECT_EQ(asked("01 03 00 00 00 32").substr(0, 5), "03 64");
  EXPECT_EQ(asked("01 03 00 00 00 33"), "83 03");
  EXPECT_EQ(asked("01 01 00 00 00 33").substr(0, 5), "01 07");
  settings_.max_read_code = 2;
  EXPECT_EQ(asked("01 04 00 00 00 33"), "84 02");
  EXPECT_EQ(asked("01 04 00 00 00 7E"), "84 03");
}

TEST_F(ModbusDevice, OtherUnitsAreNotItsBusiness) {
  EXPECT_EQ(asked("02 06 00 01 00 05"), "");
  EXPECT_EQ(differences(plc_, "hr:1=0"), "");
}

TEST_F(ModbusDevice, BroadcastIsCarriedOutAndNotAnswered) {
  EXPECT_EQ(asked("00 06 00 01 00 AA"), "");
  EXPECT_EQ(asked("00 0F 00 08 00 02 01 03"), "");
  EXPECT_EQ(asked("00 03 00 01 00 01"), "");
  EXPECT_EQ(asked("00 2B 0E 01 00"), "");
  EXPECT_EQ(differences(plc_, "hr:1=AA; co:8=1 1 0"), "");
}

TEST_F(ModbusDevice, CounterCountsScansInEveryRegister) {
  plc_ = make_device("counter");
  plc_.advance(TimePoint{milliseconds(20 * 7)});
  EXPECT_EQ(asked("01 03 00 00 00 02"), "03 04 00 07 00 08");
  EXPECT_EQ(asked("01 04 FF FF 00 01"), "04 02 00 06");
  EXPECT_EQ(asked("01 06 00 00 00 63"), "06 00 00 00 63");
  EXPECT_EQ(asked("01 03 00 00 00 01"), "03 02 00 07");
}

TEST(ModbusRtu, WrongCrcIsSilence) {
  auto plc = make_device();
  const auto device = make_modbus(Protocol::modbus_rtu, {});
  auto request = rtu("01 06 00 01 00 05");
  request.back() ^= 0x01U;
  EXPECT_TRUE(replies_of(*device, plc, request).empty());
  EXPECT_EQ(differences(plc, "hr:1=0"), "");
}

TEST(ModbusRtu, RequestsEndByTheirLengthAndMayFollowEachOther) {
  auto plc = make_device();
  const auto device = make_modbus(Protocol::modbus_rtu, {});
  auto requests = rtu("01 06 00 01 00 05");
  for (const auto* next : {"01 10 00 02 00 01 02 00 06", "01 03 00 01 00 02"}) {
    const auto bytes = rtu(next);
    requests.insert(requests.end(), bytes.begin(), bytes.end());
  }
  auto expected = rtu("01 06 00 01 00 05");
  for (const auto* next : {"01 10 00 02 00 01", "01 03 04 00 05 00 06"}) {
    const auto bytes = rtu(next);
    expected.insert(expected.end(), bytes.begin(), bytes.end());
  }
  EXPECT_EQ(to_hex(replies_of(*device, plc, requests)), to_hex(expected));
}

TEST(ModbusRtu, SilenceForgetsHalfARequest) {
  auto plc = make_device();
  const auto device = make_modbus(Protocol::modbus_rtu, {});
  const auto framer = device->make_framer();
  const auto request = rtu("01 03 00 00 00 01");
  EXPECT_TRUE(replies_of(*device, *framer, plc, ByteView(request).first(5)).empty());
  const auto late = TimePoint{milliseconds(5 + 51)};
  EXPECT_EQ(to_hex(replies_of(*device, *framer, plc, request, late)), "01 03 02 00 00 B8 44");
}

TEST(ModbusAscii, ColonStartsAnewAndLowerCaseIsTaken) {
  auto plc = make_device();
  const auto device = make_modbus(Protocol::modbus_ascii, {.unit = 0x11});
  const std::string_view line = ":1103:1103006b00037e\r\n";
  const auto reply = replies_of(*device, plc, Bytes(line.begin(), line.end()));
  EXPECT_EQ(as_text(reply), ":110306000000000000E6\r\n");
}

TEST(ModbusAscii, WrongLrcAndWhatIsNoLineAreSilence) {
  auto plc = make_device();
  const auto device = make_modbus(Protocol::modbus_ascii, {.unit = 0x11});
  for (const std::string_view line :
       {":1103006B00037D\r\n", ":1103006B0003 7E\r\n", ":1103006B00037\r\n", ":1103006B00037E\n",
        "1103006B00037E\r\n", ":\r\n", ":11\r\n"}) {
    SCOPED_TRACE(line);
    EXPECT_TRUE(replies_of(*device, plc, Bytes(line.begin(), line.end())).empty());
  }
}

TEST(ModbusTcp, RequestsInOnePieceAndInPieces) {
  auto plc = make_device();
  const auto device = make_modbus(Protocol::modbus_tcp, {});
  const auto framer = device->make_framer();
  const auto two = hex("00 01 00 00 00 06 01 03 00 00 00 01 00 02 00 00 00 06 01 03 00 00 00 01");
  EXPECT_EQ(to_hex(replies_of(*device, *framer, plc, ByteView(two).first(15))),
            "00 01 00 00 00 05 01 03 02 00 00");
  EXPECT_EQ(to_hex(replies_of(*device, *framer, plc, ByteView(two).subspan(15))),
            "00 02 00 00 00 05 01 03 02 00 00");
}

TEST(ModbusTcp, UnitZeroIsNoBroadcast) {
  auto plc = make_device();
  const auto request = hex("00 01 00 00 00 06 00 06 00 01 00 05");
  EXPECT_TRUE(replies_of(*make_modbus(Protocol::modbus_tcp, {.unit = 1}), plc, request).empty());
  EXPECT_EQ(differences(plc, "hr:1=0"), "");
  EXPECT_EQ(replies_of(*make_modbus(Protocol::modbus_tcp, {.unit = 0}), plc, request), request);
}

TEST(ModbusTcp, AnotherProtocolIsSkippedAndALengthThatCannotBeIsTheEnd) {
  auto plc = make_device();
  const auto device = make_modbus(Protocol::modbus_tcp, {});
  const auto framer = device->make_framer();
  const auto good = hex("00 02 00 00 00 06 01 03 00 00 00 01");
  EXPECT_TRUE(
      replies_of(*device, *framer, plc, hex("00 01 00 01 00 06 01 03 00 00 00 01")).empty());
  EXPECT_FALSE(replies_of(*device, *framer, plc, good).empty());
  EXPECT_TRUE(replies_of(*device, *framer, plc, hex("00 01 00 00 01 00")).empty());
  EXPECT_TRUE(replies_of(*device, *framer, plc, good).empty());
}

TEST(ModbusTcp, PduShorterThanItsFunctionNeedsIsAnIllegalValue) {
  auto plc = make_device();
  const auto device = make_modbus(Protocol::modbus_tcp, {});
  for (const std::string_view pdu :
       {"03 00 00 00", "05 00 00 FF", "06 00 00 00 00 00", "10 00 00 00 01", "10 00 00 00 01 02 00",
        "16 00 00 00 00", "17 00 00 00 01 00 00 00 01", "0F 00 00 00 01 02 01 00"}) {
    SCOPED_TRACE(pdu);
    auto request = hex("00 01 00 00 00 00 01");
    const auto bytes = hex(pdu);
    request.insert(request.end(), bytes.begin(), bytes.end());
    request[5] = static_cast<std::uint8_t>(1 + bytes.size());
    const auto reply = replies_of(*device, plc, request);
    ASSERT_EQ(reply.size(), 9U);
    EXPECT_EQ(reply[7], bytes[0] | 0x80U);
    EXPECT_EQ(reply[8], 3U);
  }
}

TEST(ModbusFlaws, LeaveTheRestAsItShouldBe) {
  struct Row {
    Protocol protocol;
    Flaw flaw;
    std::string_view before;
    std::string_view after;
  };
  for (const auto& row : {
           Row{Protocol::modbus_rtu, Flaw::sum, "01 03 02 00 64 B9 AF", "01 03 02 00 64 B9 30"},
           Row{Protocol::modbus_rtu, Flaw::sender, "01 03 02 00 64 B9 AF", "02 03 02 00 64 FD AF"},
           Row{Protocol::modbus_rtu, Flaw::length, "01 03 02 00 64 B9 AF", "01 03 02 00 64 B9 AF"},
           Row{Protocol::modbus_ascii, Flaw::sum,  // :1181026C
               "3A 31 31 38 31 30 32 36 43 0D 0A", "3A 31 31 38 31 30 32 36 30 0D 0A"},
           Row{Protocol::modbus_ascii, Flaw::sender,  // :1281026B
               "3A 31 31 38 31 30 32 36 43 0D 0A", "3A 31 32 38 31 30 32 36 42 0D 0A"},
           Row{Protocol::modbus_tcp, Flaw::sender, "15 00 00 00 00 03 FE 83 02",
               "15 00 00 00 00 03 FF 83 02"},
           Row{Protocol::modbus_tcp, Flaw::transaction, "15 00 00 00 00 03 FF 83 02",
               "14 FF 00 00 00 03 FF 83 02"},
           Row{Protocol::modbus_tcp, Flaw::length, "15 00 00 00 00 03 FF 83 02",
               "15 00 00 00 FF FF FF 83 02"},
       }) {
    auto reply = hex(row.before);
    make_modbus(row.protocol, {})->spoil(reply, row.flaw);
    EXPECT_EQ(to_hex(reply), row.after);
  }
}

TEST(ModbusFrames, DamagedOnesNeverMakeAReplyOfAnotherFunction) {
  std::mt19937 random(1);
  for (const auto& e : simulated("modbus.txt")) {
    const auto protocol = protocol_of(e);
    const auto device = make_modbus(protocol, {.unit = unit_of(e)});
    for (int i = 0; i < 200; ++i) {
      auto plc = make_device();
      for (const auto& frame : frames_of(*device->make_framer(), damaged(e.request, random))) {
        const auto kind = device->kind(frame);
        EXPECT_EQ(frame.whole, kind != RequestKind::malformed);
        if (!frame.whole || !device->hears(frame)) continue;
        const auto asked = unwrap_modbus(protocol, frame.bytes);
        const auto ruling = device->execute(frame, plc);
        if (ruling.reply.empty()) continue;
        const auto reply = unwrap_modbus(protocol, ruling.reply);
        EXPECT_EQ(reply.unit, asked.unit);
        EXPECT_EQ(reply.pdu.front() & 0x7FU, asked.pdu.front() & 0x7FU);
        EXPECT_EQ(ruling.verdict == Verdict::nak, (reply.pdu.front() & 0x80U) != 0);
      }
    }
  }
}

TEST(ModbusKinds, OneBitIsAForce) {
  const auto device = make_modbus(Protocol::modbus_rtu, {});
  struct Row {
    std::string_view request;
    RequestKind kind;
  };
  for (const auto& row : {
           Row{"01 01 00 00 00 01", RequestKind::read},
           Row{"01 04 00 00 00 01", RequestKind::read},
           Row{"01 05 00 00 FF 00", RequestKind::force_on},
           Row{"01 05 00 00 00 00", RequestKind::force_off},
           Row{"01 0F 00 00 00 01 01 01", RequestKind::force_on},
           Row{"01 0F 00 00 00 02 01 01", RequestKind::write},
           Row{"01 06 00 00 00 01", RequestKind::write},
           Row{"01 16 00 00 00 01 00 02", RequestKind::write},
           Row{"01 17 00 00 00 01 00 00 00 01 02 00 00", RequestKind::write},
           Row{"01 07", RequestKind::other},
       })
    EXPECT_EQ(device->kind({rtu(row.request), true, {}}), row.kind) << row.request;
}

}  // namespace
}  // namespace fxsim
