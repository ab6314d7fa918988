// Requests and replies of the FX computer link, as text from sources other than this simulator.
// printed: Mitsubishi JY992D69901 rev. E and JY997D16901, with their two misprinted sums corrected
// (BR and WR of X40). derived: built from the manual's fields, with sums computed by a separate
// script.
// ENQ, STX, ETX, ACK, NAK, EOT, CR and LF are written as < > | + - . r n.
#pragma once

#include <array>
#include <string_view>

#include "tests/sim/frame_table.h"

namespace fxsim {

struct ComputerLinkRow {
  Origin origin;
  std::string_view model;
  unsigned station;
  unsigned format;
  bool sum_check;
  std::string_view before;  // memory contents, see frame_table.h
  std::string_view after;
  std::string_view request;
  std::string_view answer;
};

constexpr auto kComputerLinkRows = std::to_array<ComputerLinkRow>({
    {Origin::printed, "FX2N", 5, 1, true, "X40=0 1 1 0 1", "", "<05FFBRAX00400547",
     ">05FF01101|E7"},
    {Origin::printed, "FX2N", 5, 1, true,
     "X40=0 0 1 0 1 1 0 0 0 1 0 0 1 0 0 0 1 0 1 1 0 0 1 1 1 1 0 1 0 1 0 1", "", "<05FFWR0X00400248",
     ">05FF1234ABCD|C8"},
    {Origin::printed, "FX2N", 5, 1, true, "TN123=7BC9 1234", "", "<05FFWR0TN1230264",
     ">05FF7BC91234|B3"},
    {Origin::printed, "FX2N", 0, 1, true, "", "M903=0 1 1 0 1", "<00FFBW0M0903050110126", "+00FF"},
    {Origin::printed, "FX2N", 0, 1, true, "",
     "M640=1 1 1 0 0 0 1 0 1 1 0 0 0 1 0 0 0 1 1 0 1 0 0 1 1 1 0 1 0 1 0 1",
     "<00FFWW0M0640022347AB9605", "+00FF"},
    {Origin::printed, "FX2N", 0, 1, true, "", "D0=1234 ACD7", "<00FFWW0D0000021234ACD7F9", "+00FF"},
    {Origin::printed, "FX2N", 5, 1, true, "", "M50=1; S100=0; Y1=1",
     "<05FFBT003M00501S01000Y00011EC", "+05FF"},
    {Origin::printed, "FX2N", 5, 1, true, "",
     "D500=1234; Y100=1 0 0 1 0 1 0 1 0 0 1 1 1 1 0 1; CN100=64",
     "<05FFWT003D05001234Y0100BCA9CN100006407", "+05FF"},
    {Origin::printed, "FX2N", 0, 1, true, "", "", "<00FFTT005ABCDE78", ">00FF05ABCDE|A3"},
    {Origin::printed, "FX2N", 0, 1, true, "", "", "<00FFTT204ABCD34", ">00FF04ABCD|5D"},
    {Origin::derived, "FX2N", 0, 1, true, "CN200=12345678", "", "<00FFWR0CN2000149",
     ">00FF12345678|93"},
    {Origin::derived, "FX2N", 0, 1, true, "M10=1 0 1 0 1", "", "<00FFBR0M00100523",
     ">00FF10101|E2"},
    {Origin::derived, "FX2N", 0, 1, true,
     "M16=0 1 0 0 1 0 0 0 1 1 0 1 0 1 0 1 1 0 1 1 0 0 1 1 0 0 1 0 1 1 0 0", "", "<00FFWR0M0016023B",
     ">00FFAB1234CD|C3"},
    {Origin::derived, "FX2N", 0, 1, true, "D350=56AB 170F", "", "<00FFWR0D03500233",
     ">00FF56AB170F|BB"},
    {Origin::printed, "FX3U", 5, 1, true,
     "X40=0 0 1 0 1 1 0 0 0 1 0 0 1 0 0 0 1 0 1 1 0 0 1 1 1 1 0 1 0 1 0 1", "",
     "<05FFQR0X00004002A2", ">05FF1234ABCD|C8"},
    {Origin::derived, "FX3U", 5, 1, true, "",
     "M640=1 1 1 0 0 0 1 0 1 1 0 0 0 1 0 0 0 1 1 0 1 0 0 1 1 1 0 1 0 1 0 1",
     "<05FFQW0M000640022347AB9664", "+05FF"},
    {Origin::derived, "FX3U", 5, 1, true, "", "R12000=1234; Y100=1 0 0 1 0 1 0 1 0 0 1 1 1 1 0 1",
     "<05FFQT002R0120001234Y000100BCA9E0", "+05FF"},
    {Origin::derived, "FX3U", 5, 1, true, "CN200=12345678", "", "<05FFQR0CN0020001A8",
     ">05FF12345678|98"},
    {Origin::derived, "FX2N", 5, 4, true, "X40=0 1 1 0 1", "", "<05FFBRAX00400547rn",
     ">05FF01101|E7rn"},
    {Origin::derived, "FX2N", 0, 4, true, "", "D0=1234 ACD7", "<00FFWW0D0000021234ACD7F9rn",
     "+00FFrn"},
    {Origin::derived, "FX2N", 15, 4, true, "", "", "<0FFFPC0C5rn", ">0FFF9D|82rn"},
    {Origin::derived, "FX2N", 5, 1, false, "X40=0 1 1 0 1", "", "<05FFBRAX004005", ">05FF01101|"},
    {Origin::derived, "FX2N", 0, 1, false, "", "D0=1234 ACD7", "<00FFWW0D0000021234ACD7", "+00FF"},
    {Origin::derived, "FX2N", 15, 1, false, "", "", "<0FFFPC0", ">0FFF9D|"},
    {Origin::derived, "FX2N", 5, 4, false, "X40=0 1 1 0 1", "", "<05FFBRAX004005rn",
     ">05FF01101|rn"},
    {Origin::derived, "FX2N", 0, 4, false, "", "D0=1234 ACD7", "<00FFWW0D0000021234ACD7rn",
     "+00FFrn"},
    {Origin::derived, "FX2N", 15, 4, false, "", "", "<0FFFPC0rn", ">0FFF9D|rn"},
    {Origin::derived, "FX2N", 0, 1, true, "", "", ".", ""},
    {Origin::derived, "FX2N", 0, 4, true, "", "", ".rn", ""},
});

}  // namespace fxsim
