#include "protocol/explanation.h"

#include <gtest/gtest.h>

#include "protocol/catalog.h"
#include "protocol/value/bytes.h"

namespace fxagent {
namespace {

std::string summary_of(std::string_view protocol, std::string_view frame, Direction direction) {
  const ProtocolInfo& info = *find_protocol(protocol);
  const auto codec = info.make(default_options(info));
  return summary((*codec)->explain(*from_hex(frame), direction));
}

/// Converts a frame printed as text: < STX, > ETX, ! ENQ, . ACK, ? NAK.
std::string link(std::string_view text) {
  std::string hex;
  for (const char c : text) {
    const std::string_view marks = "<>!.?";
    const std::string_view codes = "0203050615";
    const auto at = marks.find(c);
    Bytes one{static_cast<std::uint8_t>(c)};
    hex += at == marks.npos ? to_hex(one) : std::string(codes.substr(2 * at, 2));
  }
  return hex;
}

struct Row {
  std::string_view protocol;
  std::string frame;
  Direction direction;
  std::string_view says;
};

// The worked frames of protocol/README.md, from the manuals and from captures.
TEST(Explanation, OneLineSaysWhatAFrameMeans) {
  const Row rows[] = {
      {"fx-programming-port", "05", Direction::request, "enquire"},
      {"fx-programming-port", "06", Direction::reply, "ack"},
      {"fx-programming-port", "15", Direction::reply, "nak"},
      {"fx-programming-port", "02 30 31 30 46 36 30 34 03 37 34", Direction::request,
       "read D123 × 2"},
      {"fx-programming-port", "02 33 34 31 32 43 44 41 42 03 44 37", Direction::reply,
       "data 1234 ABCD"},
      {"fx-programming-port", "02 31 31 30 46 36 30 34 33 34 31 32 43 44 41 42 03 34 39",
       Direction::request, "write D123 × 2 = 1234 ABCD"},
      {"fx-programming-port", "02 37 30 30 30 35 03 46 46", Direction::request, "force_on Y0 × 1"},
      {"fx-programming-port", "02 33 35 38 34 03 44 36", Direction::reply,
       "data 8435: sum D6 given, D7 computed"},
      {"fx-programming-port", "82", Direction::reply,
       "other: the frame does not begin with STX (02)"},
      {"fx-computer-link", link("!05FFBRAX00400547"), Direction::request, "read X40 × 5"},
      {"fx-computer-link", link("<05FF01101>E7"), Direction::reply, "data 0 1 1 0 1"},
      {"fx-computer-link", link(".00FF"), Direction::reply, "ack"},
      {"modbus-rtu", "11 01 00 13 00 13 8E 92", Direction::request, "read co:19 × 19"},
      {"modbus-tcp", "15 01 00 00 00 06 FF 01 00 13 00 13", Direction::request, "read co:19 × 19"},
      {"mc-1e", "00 FF 0A 00 64 00 00 00 20 4D 08 00", Direction::request, "read M100 × 8"},
      {"mc-1e", "81 00 9D 82 3E 55", Direction::reply, "data 829D 553E"},
      {"mc-1e", "13 FF 0A 00", Direction::request, "other, remote RUN"},
  };
  for (const Row& row : rows)
    EXPECT_EQ(summary_of(row.protocol, row.frame, row.direction), row.says) << row.frame;
}

TEST(Explanation, ARefusalIsToldWithItsReason) {
  EXPECT_TRUE(
      summary_of("fx-computer-link", link("?05FF06"), Direction::reply).starts_with("nak 06, "));
  EXPECT_TRUE(summary_of("modbus-tcp", "15 01 00 00 00 03 FF 81 02", Direction::reply)
                  .starts_with("nak 02: illegal data address"));
  EXPECT_EQ(summary_of("mc-1e", "81 57", Direction::reply),
            "nak 57: too many points, or beyond the last device");
}

TEST(Explanation, OfManyValuesTheFirstSixteenAreShown) {
  std::string registers;
  for (int i = 0; i < 20; ++i) registers += " 00 07";
  const std::string line =
      summary_of("modbus-tcp", "15 01 00 00 00 2B FF 03 28" + registers, Direction::reply);
  std::string sixteen = "data";
  for (int i = 0; i < 16; ++i) sixteen += " 0007";
  EXPECT_EQ(line, sixteen + " …");
}

}  // namespace
}  // namespace fxagent
