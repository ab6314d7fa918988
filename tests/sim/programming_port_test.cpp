#include "tests/sim/programming_port.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/sim/sample_plc.h"
#include "tests/sim/transcripts.h"

namespace fxsim {
namespace {

using std::chrono::milliseconds;

/// Converts "E7000C|52" to the bytes on the wire; "ACK" and "NAK" are one byte.
Bytes message(std::string_view text) {
  if (text == "ACK") return {0x06};
  if (text == "NAK") return {0x15};
  Bytes bytes{0x02};
  for (const char c : text) bytes.push_back(c == '|' ? 0x03 : static_cast<std::uint8_t>(c));
  return bytes;
}

/// Puts `text` between STX and ETX and appends the matching sum.
Bytes framed(std::string_view text) {
  auto bytes = message(text);
  bytes.push_back(0x03);
  unsigned sum = 0;
  for (const auto byte : bytes) sum += byte;
  sum -= 0x02;  // STX is not part of the sum
  for (const auto nibble : {sum >> 4U & 0xFU, sum & 0xFU})
    bytes.push_back(static_cast<std::uint8_t>(nibble < 10 ? '0' + nibble : 'A' + nibble - 10));
  return bytes;
}

Bytes replies_of(Plc& plc, ByteView bytes, Framer& framer, TimePoint when = TimePoint{}) {
  return replies_of(*make_programming_port(), framer, plc, bytes, when);
}

Bytes replies_of(Plc& plc, ByteView bytes) {
  return replies_of(plc, bytes, *make_programming_port()->make_framer());
}

Bytes ask(std::string_view model, ByteView request) {
  auto plc = make_plc(model);
  return replies_of(plc, request);
}

bool is_refused(const test::Exchange& e) { return e.device == "-" && e.operation != "enquire"; }

TEST(ProgrammingPort, ExchangesOfTheTranscriptsAreCarriedOut) {
  for (const auto& e : simulated("fx_programming_port.txt")) {
    if (is_refused(e)) continue;
    for (const auto& model : part_in(e).models) {
      SCOPED_TRACE(model + " " + e.where());
      expect_exchange(e, *make_programming_port(), make_plc(model));
    }
  }
}

// They change the program or the speed, or are not needed for device access.
TEST(ProgrammingPort, WhatIsNoDeviceAccessIsRefused) {
  for (const auto& e : simulated("fx_programming_port.txt")) {
    if (!is_refused(e)) continue;
    SCOPED_TRACE(e.where());
    EXPECT_EQ(to_hex(ask(e.model, e.request)), "15");
  }
}

TEST(ProgrammingPort, WrongSumIsRefusedAndNotCarriedOut) {
  EXPECT_EQ(ask("FX2N", message("0E0202|00")), message("NAK"));
  auto plc = make_plc("FX3U");
  EXPECT_EQ(replies_of(plc, message("76408|0D")), message("NAK"));  // the sum of M100 ON is 0C
  EXPECT_EQ(plc.memory().get({Kind::m, 100}), 0U);
}

// Requests with a correct sum and wrong content.
TEST(ProgrammingPort, FramesOfWrongShapeAreRefused) {
  for (const auto* request : {
           "010c802",      // lower-case hex
           "010C8",        // no count
           "010C800",      // nothing to read
           "010C80200",    // a read with data
           "110C80234",    // one byte of data instead of two
           "110C80212G4",  // seven digits
           "110C8021G34",  // not hex
           "7640",         // half an address
           "7640800",      // more than an address
           "",             // nothing
       }) {
    SCOPED_TRACE(request);
    EXPECT_EQ(ask("FX3U", framed(request)), message("NAK"));
  }
}

TEST(ProgrammingPort, ClassicCommandsEndAtD1023) {
  EXPECT_EQ(ask("FX3U", framed("017FE02")), message("0000|C3"));  // D1023
  EXPECT_EQ(ask("FX3U", framed("0180002")), message("NAK"));      // D1024
  EXPECT_EQ(ask("FX3U", framed("017FE04")), message("NAK"));      // D1023 and D1024
}

TEST(ProgrammingPort, SixtyFourBytesAreTheMostButOnFx3) {
  EXPECT_EQ(ask("FX2N", framed("E00400040")).size(), 132U);
  EXPECT_EQ(ask("FX2N", framed("E00400041")), message("NAK"));
  EXPECT_EQ(ask("FX2N", framed("E004000FE")), message("NAK"));
  EXPECT_EQ(ask("FX3U", framed("E004000FE")).size(), 512U);
  EXPECT_EQ(ask("FX3U", framed("E004000FF")), message("NAK"));
  EXPECT_EQ(ask("FX3U", framed("0100041")), message("NAK"));  // classic has a limit of 64
}

TEST(ProgrammingPort, DevicesThatTheModelLacksAreRefused) {
  struct Row {
    std::string_view model, request, what;
    bool there;
  };
  for (const auto& row : {
           Row{"FX0N", "011FE02", "D255", true},
           Row{"FX0N", "0120002", "D256", false},
           Row{"FX0N", "0013F01", "M504 to M511", true},
           Row{"FX0N", "0014001", "M512", false},
           Row{"FX0N", "7FF09", "M511 ON", true},
           Row{"FX0N", "7000A", "M512 ON", false},
           Row{"FX0N", "00C0004", "C200, which FX0N has not", false},
           Row{"FX0N", "00C8C04", "C235", true},
           Row{"FX0N", "E00400002", "D0 by an E command", false},
           Row{"FX1S", "E00400002", "D0 by an E command", false},
           Row{"FX1S", "70D05", "Y15 ON", true},
           Row{"FX1S", "70E05", "Y16 ON", false},
           Row{"FX1N", "E0000C001", "M1536 to M1543", false},
           Row{"FX1N", "E7FF05", "M1535 ON", true},
           Row{"FX1N", "E70006", "M1536 ON", false},
           Row{"FX2N", "E70006", "M1536 ON", true},
           Row{"FX3U", "E7FF5D", "M7679 ON", true},
           Row{"FX3U", "0009001", "X200 to X207", true},
           Row{"FX3G", "0009001", "X200 to X207", false},
           Row{"FX3U", "0014F02", "M632 to M647", true},
           Row{"FX3U", "0020001", "after M8255", false},
           Row{"FX3U", "E0081FE02", "D8255", true},
           Row{"FX3U", "E0083FE02", "D8511", true},
           Row{"FX3U", "E00840002", "D8512", false},
           Row{"FX2N", "E00800002", "no D8000 at 8000 on FX2N", false},
       }) {
    SCOPED_TRACE(std::string(row.model) + " " + std::string(row.what));
    EXPECT_EQ(ask(row.model, framed(row.request)) != message("NAK"), row.there);
  }
}

// Every captured force follows this rule, so an error in either column of a table fails here.
TEST(ProgrammingPort, ForceAddressIsEightTimesTheByteAddress) {
  for (const auto set : {CommandSet::classic, CommandSet::fx1n_fx2n, CommandSet::fx3}) {
    unsigned bits = 0;
    for (std::uint32_t address = 0; address <= 0xFFFF; ++address) {
      const auto place = byte_at(set, address);
      if (!place || width(place->kind) != 1) continue;
      for (unsigned bit = 0; bit < 8; ++bit, ++bits) {
        const auto device = bit_at(set, (address * 8 + bit) & 0xFFFFU);
        ASSERT_TRUE(device.has_value()) << std::hex << address;
        ASSERT_EQ(*device, (Device{place->kind, static_cast<unsigned>(place->offset * 8 + bit)}))
            << std::hex << address;
      }
    }
    EXPECT_GT(bits, 4000U);
  }
}

TEST(ProgrammingPort, TypeWordsTellTheModel) {
  struct Row {
    std::string_view model, d8001, d8101;
  };
  for (const auto& row : {
           Row{"FX1S", "C256|E3", "0000|C3"},
           Row{"FX1N", "6266|D7", "0000|C3"},
           Row{"FX2N", "F65E|F9", "F65E|F9"},
           Row{"FX3S", "C46D|F4", "C46D|F4"},
           Row{"FX3G", "7766|DD", "7766|DD"},
           Row{"FX3U", "A85E|F6", "683F|EA"},
       }) {
    SCOPED_TRACE(row.model);
    EXPECT_EQ(ask(row.model, framed("00E0202")), message(row.d8001));
    EXPECT_EQ(ask(row.model, framed("00ECA02")), message(row.d8101));
  }
}

TEST(ProgrammingPort, TypeWordCannotBeWritten) {
  auto plc = make_plc("FX2N");
  EXPECT_EQ(replies_of(plc, framed("10E02020000")), message("ACK"));
  EXPECT_EQ(plc.memory().get({Kind::special_d, 1}), 24310U);
}

TEST(ProgrammingPort, M8037StopsAndStarts) {
  struct Row {
    std::string_view model, stop, run;
  };
  for (const auto& row : {
           Row{"FX2N", "E7250E", "E8250E"},
           Row{"FX3U", "E72560", "E82560"},
           Row{"FX1S", "7250F", "8250F"},
       }) {
    SCOPED_TRACE(row.model);
    auto plc = make_plc(row.model);
    EXPECT_EQ(replies_of(plc, framed(row.stop)), message("ACK"));
    EXPECT_EQ(replies_of(plc, message("001E001|6A")), message("0A|74"));
    EXPECT_FALSE(plc.running());
    EXPECT_EQ(replies_of(plc, framed(row.run)), message("ACK"));
    EXPECT_EQ(replies_of(plc, message("001E001|6A")), message("09|6C"));
    EXPECT_TRUE(plc.running());
  }
}

TEST(ProgrammingPort, M8036StartsWhileM8035IsOn) {
  auto plc = make_plc("FX3U");
  replies_of(plc, message("E72560|4C"));  // M8037 ON
  replies_of(plc, framed("E72460"));      // M8036 ON alone
  EXPECT_FALSE(plc.running());
  replies_of(plc, framed("E72360"));  // M8035 ON
  replies_of(plc, framed("E72460"));
  EXPECT_TRUE(plc.running());
}

TEST(ProgrammingPort, SwitchInStopKeepsThePlcStopped) {
  auto plc = make_plc("FX3U");
  plc.set_run_switch(false);
  EXPECT_EQ(replies_of(plc, message("E82560|4D")), message("ACK"));
  EXPECT_FALSE(plc.running());
}

TEST(ProgrammingPort, ByteWriteOverM8037IsAnOrderOnlyWhereItChanges) {
  auto plc = make_plc("FX3U");
  replies_of(plc, framed("101E40100"));  // M8032 to M8039, all remain OFF
  EXPECT_TRUE(plc.running());
  replies_of(plc, framed("101E40120"));
  EXPECT_FALSE(plc.running());
}

TEST(ProgrammingPortFramer, EnquiryInTheMiddleOfAFrameStartsAfresh) {
  auto plc = make_plc("FX3U");
  auto bytes = message("010C8");
  bytes.push_back(0x05);
  const auto whole = message("00E0202|6C");
  bytes.insert(bytes.end(), whole.begin(), whole.end());
  auto expected = Bytes{0x06};
  const auto reply = message("A85E|F6");
  expected.insert(expected.end(), reply.begin(), reply.end());
  EXPECT_EQ(replies_of(plc, bytes), expected);
}

TEST(ProgrammingPortFramer, HalfAFrameIsForgottenAfter200MsOfSilence) {
  auto plc = make_plc("FX3U");
  const auto request = message("00E0202|6C");
  const auto framer = make_programming_port()->make_framer();
  const auto half = ByteView(request).first(5);
  const auto rest = ByteView(request).subspan(5);
  EXPECT_TRUE(replies_of(plc, half, *framer, TimePoint(milliseconds(0))).empty());
  EXPECT_FALSE(replies_of(plc, rest, *framer, TimePoint(milliseconds(199))).empty());
  EXPECT_TRUE(replies_of(plc, half, *framer, TimePoint(milliseconds(1000))).empty());
  EXPECT_TRUE(replies_of(plc, rest, *framer, TimePoint(milliseconds(1206))).empty());
}

TEST(ProgrammingPortFramer, NonsenseIsMetWithSilence) {
  for (const auto* hex : {
           "41 42 43",                          // outside a frame
           "06", "15", "03",                    // control codes that do not begin a request
           "02 30 30 45 B0 32 30 32 03 36 43",  // a character with bit 7
           "02 30 30 0A 30 32 30 32 03 36 43",  // a control code inside
           "02 30 30 45 30 32 30 32",           // never ends
       }) {
    SCOPED_TRACE(hex);
    auto plc = make_plc("FX3U");
    const auto framer = make_programming_port()->make_framer();
    EXPECT_TRUE(replies_of(plc, from_hex(hex).value(), *framer).empty());
    // The next request is answered normally.
    EXPECT_EQ(replies_of(plc, message("00E0202|6C"), *framer), message("A85E|F6"));
  }
}

TEST(ProgrammingPortFramer, EndlessFrameIsGivenUp) {
  const auto framer = make_programming_port()->make_framer();
  std::vector<Frame> frames;
  framer->take(0x02, TimePoint{}, frames);
  for (int i = 0; i < 2000; ++i) framer->take('0', TimePoint{}, frames);
  ASSERT_FALSE(frames.empty());
  EXPECT_TRUE(std::ranges::none_of(frames, &Frame::whole));
}

}  // namespace
}  // namespace fxsim
