// Requests and replies of the MC protocol, as bytes from sources other than this simulator.
// printed: Mitsubishi SH-080008 (iQ-R edition), JY997D45801, JY997D18101, JY997D56001. captured:
// from R08, R120P, L16H and FX5UC CPUs, published with plc-comm-slmp-python. derived: a printed
// message, or one built by a library, put into a frame by a separate script.
// Binary is written in hexadecimal and ASCII as text, in which ENQ, STX, ETX, ACK, NAK, CR and LF
// are < > | + - r n.
#pragma once

#include <array>
#include <string_view>

#include "tests/sim/frame_table.h"
#include "tests/sim/mc.h"

namespace fxsim {

/// Converts a table entry to the bytes of the frame.
inline Bytes mc_bytes(std::string_view text, McCode code) {
  if (code == McCode::binary) return from_hex(text).value();
  constexpr std::string_view kWritten = "<>|+-rn";
  constexpr std::string_view kMeant = "\x05\x02\x03\x06\x15\r\n";
  Bytes bytes;
  for (const char character : text) {
    const auto at = kWritten.find(character);
    bytes.push_back(
        static_cast<std::uint8_t>(at == std::string_view::npos ? character : kMeant[at]));
  }
  return bytes;
}

struct McRow {
  Origin origin;
  Protocol protocol;
  std::string_view model;
  McCode code;
  bool run;
  std::string_view before;  // memory contents, see frame_table.h
  std::string_view after;
  std::string_view request;
  std::string_view answer;
};

constexpr auto kMcRows = std::to_array<McRow>({
    {Origin::printed, Protocol::mc_4e, "Q", McCode::binary, true,
     "M100=0 0 1 0 1 1 0 0 0 1 0 0 1 0 0 0 0 1 0 0 0 0 0 0 0 0 0 0 0 0 0 0", "",
     "50 00 00 FF FF 03 00 0C 00 10 00 01 04 00 00 64 00 00 90 02 00",
     "D0 00 00 FF FF 03 00 06 00 00 00 34 12 02 00"},
    {Origin::derived, Protocol::mc_4e, "Q", McCode::binary, true, "D350=56AB 170F", "",
     "50 00 00 FF FF 03 00 0C 00 10 00 01 04 00 00 5E 01 00 A8 02 00",
     "D0 00 00 FF FF 03 00 06 00 00 00 AB 56 0F 17"},
    {Origin::derived, Protocol::mc_4e, "Q", McCode::binary, true, "D350=56AB 170F", "",
     "54 00 34 12 00 00 00 FF FF 03 00 0C 00 10 00 01 04 00 00 5E 01 00 A8 02 00",
     "D4 00 34 12 00 00 00 FF FF 03 00 06 00 00 00 AB 56 0F 17"},
    {Origin::derived, Protocol::mc_4e, "Q", McCode::ascii, true, "D350=56AB 170F", "",
     "54001234000000FF03FF000018001004010000D*0003500002",
     "D4001234000000FF03FF00000C000056AB170F"},
    {Origin::derived, Protocol::mc_3e, "FX5U", McCode::ascii, true, "M100=0 0 0 1 0 0 1 1", "",
     "500000FF03FF000018001004010001M*0001000008", "D00000FF03FF00000C000000010011"},
    {Origin::derived, Protocol::mc_3e, "FX5U", McCode::binary, true, "M100=0 0 0 1 0 0 1 1", "",
     "50 00 00 FF FF 03 00 0C 00 10 00 01 04 01 00 64 00 00 90 08 00",
     "D0 00 00 FF FF 03 00 06 00 00 00 00 01 00 11"},
    {Origin::derived, Protocol::mc_4e, "Q", McCode::binary, true,
     "D0=1995; TN0=1202; M100=0 0 0 0 1 1 0 0 0 0 0 0 0 1 0 0; X20=1 0 0 1 0 0 1 0 0 0 0 1 0 0 1 "
     "0; D1500=4F4E 4C54; Y160=1 1 1 1 0 1 0 1 1 0 0 1 1 1 0 1 0 1 1 1 1 0 1 1 1 1 0 0 0 0 1 1; "
     "M1111=1 1 1 0 1 1 0 1 0 0 1 1 1 1 0 1 1 0 1 1 1 0 1 1 0 1 0 1 1 1 0 1",
     "",
     "50 00 00 FF FF 03 00 24 00 10 00 03 04 00 00 04 03 00 00 00 A8 00 00 00 C2 64 00 00 90 20 00 "
     "00 9C DC 05 00 A8 60 01 00 9D 57 04 00 90",
     "D0 00 00 FF FF 03 00 16 00 00 00 95 19 02 12 30 20 49 48 4E 4F 54 4C AF B9 DE C3 B7 BC DD "
     "BA"},
    {Origin::derived, Protocol::mc_4e, "Q", McCode::ascii, true, "",
     "D0=550 575; M100=0 0 0 0 0 0 1 0 1 0 1 0 0 0 0 0; X20=1 1 0 0 0 0 0 1 1 0 1 0 0 0 0 0; "
     "D1500=4391 1202; Y160=1 1 1 0 0 0 0 0 0 1 1 0 0 1 0 0 1 0 1 0 1 1 1 0 1 1 0 0 0 1 0 0; "
     "M1111=1 0 1 0 1 1 1 0 0 0 1 0 0 0 0 0 1 0 1 0 0 1 0 0 0 0 1 0 0 0 0 0",
     "500000FF03FF0000700010140200000403D*0000000550D*0000010575M*0001000540X*0000200583D*"
     "00150012024391Y*00016023752607M*00111104250475",
     "D00000FF03FF0000040000"},
    {Origin::derived, Protocol::mc_4e, "Q", McCode::binary, true, "",
     "D0=550 575; M100=0 0 0 0 0 0 1 0 1 0 1 0 0 0 0 0; X20=1 1 0 0 0 0 0 1 1 0 1 0 0 0 0 0; "
     "D1500=4391 1202; Y160=1 1 1 0 0 0 0 0 0 1 1 0 0 1 0 0 1 0 1 0 1 1 1 0 1 1 0 0 0 1 0 0; "
     "M1111=1 0 1 0 1 1 1 0 0 0 1 0 0 0 0 0 1 0 1 0 0 1 0 0 0 0 1 0 0 0 0 0",
     "50 00 00 FF FF 03 00 38 00 10 00 02 14 00 00 04 03 00 00 00 A8 50 05 01 00 00 A8 75 05 64 00 "
     "00 90 40 05 20 00 00 9C 83 05 DC 05 00 A8 91 43 02 12 60 01 00 9D 07 26 75 23 57 04 00 90 75 "
     "04 25 04",
     "D0 00 00 FF FF 03 00 02 00 00 00"},
    {Origin::derived, Protocol::mc_4e, "Q", McCode::ascii, true, "", "M50=0; Y2F=1",
     "500000FF03FF00002200101402000102M*00005000Y*00002F01", "D00000FF03FF0000040000"},
    {Origin::derived, Protocol::mc_4e, "Q", McCode::binary, true, "", "M50=0; Y2F=1",
     "50 00 00 FF FF 03 00 11 00 10 00 02 14 01 00 02 32 00 00 90 00 2F 00 00 9D 01",
     "D0 00 00 FF FF 03 00 02 00 00 00"},
    {Origin::derived, Protocol::mc_3e, "iQ-R", McCode::binary, true, "", "M50=0; Y2F=1",
     "50 00 00 FF FF 03 00 17 00 10 00 02 14 03 00 02 32 00 00 00 90 00 00 00 2F 00 00 00 9D 00 01 "
     "00",
     "D0 00 00 FF FF 03 00 02 00 00 00"},
    {Origin::derived, Protocol::mc_4e, "Q", McCode::binary, true, "",
     "D0=1234 5678; M100=1 0 1 0 1 0 1 0 0 1 0 1 0 1 0 1",
     "50 00 00 FF FF 03 00 1A 00 10 00 06 14 00 00 01 01 00 00 00 A8 02 00 34 12 78 56 64 00 00 90 "
     "01 00 55 AA",
     "D0 00 00 FF FF 03 00 02 00 00 00"},
    {Origin::derived, Protocol::mc_4e, "Q", McCode::binary, true, "", "",
     "50 00 00 FF FF 03 00 06 00 10 00 01 01 00 00",
     "D0 00 00 FF FF 03 00 14 00 00 00 51 30 32 55 43 50 55 20 20 20 20 20 20 20 20 20 63 02"},
    {Origin::derived, Protocol::mc_4e, "Q", McCode::binary, true, "", "",
     "50 00 00 FF FF 03 00 08 00 10 00 02 10 00 00 01 00", "D0 00 00 FF FF 03 00 02 00 00 00"},
    {Origin::derived, Protocol::mc_4e, "Q", McCode::ascii, true, "", "",
     "500000FF03FF0000100010100300000001", "D00000FF03FF0000040000"},
    {Origin::derived, Protocol::mc_4e, "Q", McCode::binary, false, "", "",
     "50 00 00 FF FF 03 00 08 00 10 00 05 10 00 00 01 00", "D0 00 00 FF FF 03 00 02 00 00 00"},
    {Origin::derived, Protocol::mc_4e, "Q", McCode::ascii, false, "", "",
     "500000FF03FF0000100010100500000001", "D00000FF03FF0000040000"},
    {Origin::derived, Protocol::mc_4e, "Q", McCode::ascii, false, "", "",
     "500000FF03FF0000100010100600000001", "D00000FF03FF0000040000"},
    {Origin::derived, Protocol::mc_4e, "Q", McCode::binary, true, "", "",
     "50 00 00 FF FF 03 00 0A 00 10 00 01 10 00 00 01 00 02 00",
     "D0 00 00 FF FF 03 00 02 00 00 00"},
    {Origin::derived, Protocol::mc_4e, "Q", McCode::ascii, true, "", "",
     "500000FF03FF00001400101001000000010000", "D00000FF03FF0000040000"},
    {Origin::derived, Protocol::mc_3e, "FX5U", McCode::binary, true, "", "D100=B 16 21",
     "50 00 00 FF FF 03 00 12 00 10 00 01 14 00 00 64 00 00 A8 03 00 0B 00 16 00 21 00",
     "D0 00 00 FF FF 03 00 02 00 00 00"},
    {Origin::captured, Protocol::mc_4e, "Q", McCode::binary, true, "D100=0", "",
     "50 00 00 FF FF 03 00 0C 00 10 00 01 04 00 00 64 00 00 A8 01 00",
     "D0 00 00 FF FF 03 00 04 00 00 00 00 00"},
    {Origin::captured, Protocol::mc_4e, "iQ-R", McCode::binary, true, "ZR1535996=15B3", "",
     "54 00 FE 03 00 00 00 FF FF 03 00 0C 00 10 00 01 04 00 00 FC 6F 17 B0 01 00",
     "D4 00 FE 03 00 00 00 FF FF 03 00 04 00 00 00 B3 15"},
    {Origin::captured, Protocol::mc_4e, "iQ-R", McCode::binary, true, "", "ZR1535996=292",
     "54 00 77 05 00 00 00 FF FF 03 00 0E 00 10 00 01 14 00 00 FC 6F 17 B0 01 00 92 02",
     "D4 00 77 05 00 00 00 FF FF 03 00 02 00 00 00"},
    {Origin::captured, Protocol::mc_4e, "FX5U", McCode::binary, true,
     "D300=0 0; M200=0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0", "",
     "54 00 03 00 00 00 00 FF FF 03 00 14 00 10 00 06 04 00 00 01 01 2C 01 00 A8 02 00 C8 00 00 90 "
     "01 00",
     "D4 00 03 00 00 00 00 FF FF 03 00 08 00 00 00 00 00 00 00 00 00"},
    {Origin::captured, Protocol::mc_4e, "L", McCode::binary, true, "",
     "M200=0 1 1 1 1 1 1 1 1 0 1 1 0 1 1 0",
     "54 00 08 00 00 00 00 FF FF 03 00 10 00 10 00 06 14 00 00 00 01 C8 00 00 90 01 00 FE 6D",
     "D4 00 08 00 00 00 00 FF FF 03 00 02 00 00 00"},
    {Origin::captured, Protocol::mc_4e, "FX5U", McCode::binary, true, "", "",
     "54 00 0C 00 00 00 00 FF FF 03 00 1A 00 10 00 06 14 00 00 01 01 2C 01 00 A8 02 00 C8 00 00 90 "
     "01 00 F7 87 BE 80 FE 6D",
     "D4 00 0C 00 00 00 00 FF FF 03 00 0B 00 61 C0 00 FF FF 03 00 06 14 00 00"},
    {Origin::captured, Protocol::mc_4e, "iQ-R", McCode::binary, true,
     "D300=0 0; M200=0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0", "",
     "54 00 03 00 00 00 00 FF FF 03 00 18 00 10 00 06 04 02 00 01 01 2C 01 00 00 A8 00 02 00 C8 00 "
     "00 00 90 00 01 00",
     "D4 00 03 00 00 00 00 FF FF 03 00 08 00 00 00 00 00 00 00 00 00"},
    {Origin::captured, Protocol::mc_4e, "iQ-R", McCode::binary, true, "", "D300=87F7 80BE",
     "54 00 04 00 00 00 00 FF FF 03 00 14 00 10 00 06 14 02 00 01 00 2C 01 00 00 A8 00 02 00 F7 87 "
     "BE 80",
     "D4 00 04 00 00 00 00 FF FF 03 00 02 00 00 00"},
    {Origin::captured, Protocol::mc_4e, "iQ-R", McCode::binary, true, "", "",
     "54 00 0C 00 00 00 00 FF FF 03 00 1E 00 10 00 06 14 02 00 01 01 2C 01 00 00 A8 00 02 00 C8 00 "
     "00 00 90 00 01 00 F7 87 BE 80 FE 6D",
     "D4 00 0C 00 00 00 00 FF FF 03 00 0B 00 5B C0 00 FF FF 03 00 06 14 02 00"},
    {Origin::captured, Protocol::mc_4e, "iQ-R", McCode::binary, true, "", "",
     "54 00 00 00 00 00 00 FF E0 03 00 06 00 10 00 01 01 00 00",
     "D4 00 00 00 00 00 00 FF E0 03 00 14 00 00 00 52 31 32 30 50 43 50 55 20 20 20 20 20 20 20 20 "
     "44 48"},
    {Origin::derived, Protocol::mc_4e, "iQ-R", McCode::binary, true, "D100=1234 5678", "",
     "54 00 00 00 00 00 00 FF FF 03 00 0E 00 10 00 01 04 02 00 64 00 00 00 A8 00 02 00",
     "D4 00 00 00 00 00 00 FF FF 03 00 06 00 00 00 34 12 78 56"},
    {Origin::derived, Protocol::mc_4e, "iQ-R", McCode::binary, true, "", "M101=1",
     "54 00 00 00 00 00 00 FF FF 03 00 0F 00 10 00 01 14 03 00 65 00 00 00 90 00 01 00 10",
     "D4 00 00 00 00 00 00 FF FF 03 00 02 00 00 00"},
    {Origin::derived, Protocol::mc_4e, "iQ-R", McCode::binary, true,
     "D100=1111 2222; D200=5678 1234", "",
     "54 00 00 00 00 00 00 FF FF 03 00 1A 00 10 00 03 04 02 00 02 01 64 00 00 00 A8 00 65 00 00 00 "
     "A8 00 C8 00 00 00 A8 00",
     "D4 00 00 00 00 00 00 FF FF 03 00 0A 00 00 00 11 11 22 22 78 56 34 12"},
    {Origin::derived, Protocol::mc_4e, "iQ-R", McCode::binary, true, "", "M100=1; Y20=0",
     "54 00 00 00 00 00 00 FF FF 03 00 17 00 10 00 02 14 03 00 02 64 00 00 00 90 00 01 00 20 00 00 "
     "00 9D 00 00 00",
     "D4 00 00 00 00 00 00 FF FF 03 00 02 00 00 00"},
    {Origin::derived, Protocol::mc_4e, "iQ-R", McCode::binary, true, "", "",
     "54 00 00 00 00 00 00 FF FF 03 00 0F 00 10 00 30 16 00 00 07 00 73 65 63 72 65 74 31",
     "D4 00 00 00 00 00 00 FF FF 03 00 02 00 00 00"},
});

struct McSerialRow {
  Origin origin;
  Protocol protocol;
  std::string_view model;
  unsigned format;
  std::string_view before;
  std::string_view after;
  std::string_view request;
  std::string_view answer;
};

constexpr auto kMcSerialRows = std::to_array<McSerialRow>({
    {Origin::printed, Protocol::mc_3c, "Q", 1, "",
     "M100=1 1 1 0 0 0 1 0 1 1 0 0 0 1 0 0 0 1 1 0 1 0 0 1 1 1 0 1 0 1 0 1",
     "<F90000FF0014010000M*00010000022347AB96CD", "+F90000FF00"},
    {Origin::printed, Protocol::mc_4c, "Q", 5,
     "M100=0 0 1 0 1 1 0 0 0 1 0 0 1 0 0 0 0 1 0 0 0 0 0 0 0 0 0 0 0 0 0 0", "",
     "10 02 12 00 F8 00 00 FF FF 03 00 00 01 04 00 00 64 00 00 90 02 00 10 03 30 36",
     "10 02 10 10 00 F8 00 00 FF FF 03 00 00 FF FF 00 00 34 12 02 00 10 03 34 46"},
    {Origin::derived, Protocol::mc_3c, "Q", 1,
     "M100=0 0 1 0 1 1 0 0 0 1 0 0 1 0 0 0 0 1 0 0 0 0 0 0 0 0 0 0 0 0 0 0", "",
     "<F90000FF0004010000M*00010000020A", ">F90000FF0012340002|BA"},
    {Origin::derived, Protocol::mc_3c, "Q", 2,
     "M100=0 0 1 0 1 1 0 0 0 1 0 0 1 0 0 0 0 1 0 0 0 0 0 0 0 0 0 0 0 0 0 0", "",
     "<7AF90000FF0004010000M*000100000282", ">7AF90000FF0012340002|32"},
    {Origin::derived, Protocol::mc_3c, "Q", 3,
     "M100=0 0 1 0 1 1 0 0 0 1 0 0 1 0 0 0 0 1 0 0 0 0 0 0 0 0 0 0 0 0 0 0", "",
     ">F90000FF0004010000M*0001000002|0D", ">F90000FF00QACK12340002|DA"},
    {Origin::derived, Protocol::mc_3c, "Q", 4,
     "M100=0 0 1 0 1 1 0 0 0 1 0 0 1 0 0 0 0 1 0 0 0 0 0 0 0 0 0 0 0 0 0 0", "",
     "<F90000FF0004010000M*00010000020Arn", ">F90000FF0012340002|BArn"},
    {Origin::derived, Protocol::mc_4c, "Q", 1,
     "M100=0 0 1 0 1 1 0 0 0 1 0 0 1 0 0 0 0 1 0 0 0 0 0 0 0 0 0 0 0 0 0 0", "",
     "<F80000FF03FF000004010000M*000100000258", ">F80000FF03FF000012340002|08"},
    {Origin::derived, Protocol::mc_4c, "Q", 2,
     "M100=0 0 1 0 1 1 0 0 0 1 0 0 1 0 0 0 0 1 0 0 0 0 0 0 0 0 0 0 0 0 0 0", "",
     "<7AF80000FF03FF000004010000M*0001000002D0", ">7AF80000FF03FF000012340002|80"},
    {Origin::derived, Protocol::mc_4c, "Q", 3,
     "M100=0 0 1 0 1 1 0 0 0 1 0 0 1 0 0 0 0 1 0 0 0 0 0 0 0 0 0 0 0 0 0 0", "",
     ">F80000FF03FF000004010000M*0001000002|5B", ">F80000FF03FF0000QACK12340002|28"},
    {Origin::derived, Protocol::mc_4c, "Q", 4,
     "M100=0 0 1 0 1 1 0 0 0 1 0 0 1 0 0 0 0 1 0 0 0 0 0 0 0 0 0 0 0 0 0 0", "",
     "<F80000FF03FF000004010000M*000100000258rn", ">F80000FF03FF000012340002|08rn"},
    {Origin::derived, Protocol::mc_4c, "Q", 4, "", "D100=1234 ABCD",
     "<F80000FF03FF000014010000D*00010000021234ABCD24rn", "+F80000FF03FF0000rn"},
    {Origin::derived, Protocol::mc_4c, "FX5U", 4, "", "",
     "<F80000FF03FF000004010000D*09999900017Arn", "-F80000FF03FF00007E4Frn"},
    {Origin::derived, Protocol::mc_3c, "Q", 3, "", "D100=1234 ABCD",
     ">F90000FF0014010000D*00010000021234ABCD|D9", ">F90000FF00QACK|"},
    {Origin::derived, Protocol::mc_4c, "Q", 5, "", "",
     "10 02 0E 00 F8 00 00 FF FF 03 00 00 02 10 10 00 00 01 00 10 03 31 41",
     "10 02 0C 00 F8 00 00 FF FF 03 00 00 FF FF 00 00 10 03 30 33"},
    {Origin::derived, Protocol::mc_4c, "Q", 5, "D16=1010", "",
     "10 02 12 00 F8 00 00 FF FF 03 00 00 01 04 00 00 10 10 00 00 A8 01 00 10 03 43 39",
     "10 02 0E 00 F8 00 00 FF FF 03 00 00 FF FF 00 00 10 10 10 10 10 03 32 35"},
    {Origin::derived, Protocol::mc_4c, "FX5U", 5, "", "",
     "10 02 12 00 F8 00 00 FF FF 03 00 00 01 08 00 00 01 00 00 00 00 A8 10 03 42 44",
     "10 02 0C 00 F8 00 00 FF FF 03 00 00 FF FF 40 7E 10 03 43 31"},
});

struct McOneERow {
  Origin origin;
  McCode code;
  std::string_view before;
  std::string_view after;
  std::string_view request;
  std::string_view answer;
};

constexpr auto kMcOneERows = std::to_array<McOneERow>({
    {Origin::printed, McCode::binary, "M100=1 0 1 0 0 1 1 0", "",
     "00 FF 0A 00 64 00 00 00 20 4D 08 00", "80 00 10 10 01 10"},
    {Origin::printed, McCode::binary,
     "Y100=1 0 1 1 1 0 0 1 0 1 0 0 0 0 0 1 0 1 1 1 1 1 0 0 1 0 1 0 1 0 1 0", "",
     "01 FF 0A 00 40 00 00 00 20 59 02 00", "81 00 9D 82 3E 55"},
    {Origin::printed, McCode::binary, "", "", "13 FF 0A 00", "93 00"},
    {Origin::printed, McCode::ascii, "", "", "14FF000A", "9400"},
    {Origin::printed, McCode::binary, "", "", "15 FF 0A 00", "95 00 F3 00"},
    {Origin::derived, McCode::binary, "", "D100=1234 9876 109",
     "03 FF 0A 00 64 00 00 00 20 44 03 00 34 12 76 98 09 01", "83 00"},
    {Origin::derived, McCode::binary, "", "M10=1 0 1 0 1",
     "02 FF 0A 00 0A 00 00 00 20 4D 05 00 10 10 10", "82 00"},
    {Origin::derived, McCode::ascii, "", "M10=1 0 1 0 1", "02FF000A4D200000000A0500101010", "8200"},
    {Origin::derived, McCode::binary, "", "Y20=1 0 0 1 0 1 0 0 1 1 0 1 1 1 1 0; R26=1234; CN18=50",
     "05 FF 0A 00 03 00 10 00 00 00 20 59 29 7B 1A 00 00 00 20 52 34 12 12 00 00 00 4E 43 50 00",
     "85 00"},
    {Origin::derived, McCode::binary, "", "", "01 FF 0A 00 3F 1F 00 00 20 44 02 00", "81 57"},
    {Origin::derived, McCode::binary, "", "", "01 01 0A 00 00 00 00 00 20 44 01 00", "81 5B 10 00"},
    {Origin::derived, McCode::binary, "", "D100=B 16 21",
     "03 FF 0A 00 64 00 00 00 20 44 03 00 0B 00 16 00 21 00", "83 00"},
});

/// Requests without a known reply; only their meaning is known.
struct McQuestion {
  Protocol protocol;
  std::string_view model;
  McCode code;
  std::string_view request;
  std::string_view device;
  unsigned points;
};

constexpr auto kMcQuestions = std::to_array<McQuestion>({
    {Protocol::mc_4c, "Q", McCode::binary,
     "10 02 12 00 F8 05 07 03 04 00 01 00 01 04 01 00 40 00 00 9C 05 00 10 03 30 35", "X40", 5},
    {Protocol::mc_3e, "Q", McCode::ascii, "500000FF03FF000018001004010000D*0000000004", "D0", 4},
    {Protocol::mc_4e, "Q", McCode::binary,
     "50 00 00 FF FF 03 00 26 00 10 00 06 04 00 00 02 03 00 00 00 A8 04 00 00 01 00 B4 08 00 00 00 "
     "00 90 02 00 80 00 00 90 02 00 00 01 00 A0 03 00",
     "D0", 19},
    {Protocol::mc_1e, "FX3U", McCode::binary, "00 FF 10 00 64 00 00 00 20 4D 0C 00", "M100", 12},
    {Protocol::mc_1e, "FX3U", McCode::binary, "01 FF 0A 00 00 00 00 00 20 58 01 00", "X0", 1},
    {Protocol::mc_3e, "Q", McCode::binary,
     "50 00 00 FF FF 03 00 0C 00 10 00 01 04 00 00 2C 01 00 A8 03 00", "D300", 3},
});

}  // namespace fxsim
