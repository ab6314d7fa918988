#include "tests/sim/computer_link.h"

#include <gtest/gtest.h>

#include <array>

#include "tests/sim/sample_plc.h"
#include "tests/sim/transcripts.h"

namespace fxsim {
namespace {

using std::chrono::milliseconds;

/// Builds a request to station 0, starting with the command, with the matching sum.
Bytes summed(std::string_view command) {
  auto request = from_marks("<00FF" + std::string(command));
  unsigned sum = 0;
  for (std::size_t i = 1; i < request.size(); ++i) sum += request[i];
  for (const auto nibble : {sum >> 4U & 0xFU, sum & 0xFU})
    request.push_back(static_cast<std::uint8_t>("0123456789ABCDEF"[nibble]));
  return request;
}

class ComputerLinkStation : public testing::Test {
 protected:
  /// Returns the answer of station 0 to a request that ends with its sum.
  std::string asked(std::string_view command) {
    return with_marks(replies_of(*make_computer_link({}), plc_, summed(command)));
  }
  std::string sent(std::string_view text, ComputerLinkSettings settings = {}) {
    return with_marks(replies_of(*make_computer_link(settings), plc_, from_marks(text)));
  }

  Plc plc_ = make_plc("FX3U");
};

/// Takes the settings from "5.100.1.sum": station, wait, format, sum check.
ComputerLinkSettings settings_of(const test::Exchange& e) {
  const auto parts = split(e.command_set, '.');
  return {static_cast<unsigned>(std::stoul(parts[0])), static_cast<unsigned>(std::stoul(parts[2])),
          parts[3] == "sum"};
}

TEST(ComputerLinkFrames, OfTheTranscriptsAreAnswered) {
  for (const auto& e : simulated("fx_computer_link.txt")) {
    SCOPED_TRACE(e.where());
    expect_exchange(e, *make_computer_link(settings_of(e)), make_plc(e.model));
  }
}

TEST(ComputerLinkFrames, DamagedOnesAreAnsweredByTheFormOrNotAtAll) {
  std::mt19937 random(1);
  for (const auto& e : simulated("fx_computer_link.txt")) {
    const auto link = make_computer_link(settings_of(e));
    for (int i = 0; i < 200; ++i) {
      SCOPED_TRACE(e.where());
      auto plc = make_plc(e.model);
      for (const auto& frame : frames_of(*link->make_framer(), damaged(e.request, random))) {
        link->kind(frame);
        if (frame.whole && !link->hears(frame)) continue;
        const auto ruling = link->execute(frame, plc);
        const auto answer = with_marks(ruling.reply);
        if (answer.empty()) continue;
        EXPECT_TRUE(frame.whole);
        EXPECT_EQ(ruling.verdict == Verdict::nak, answer.front() == '-');
        EXPECT_EQ(ruling.verdict == Verdict::ack, answer.front() == '+');
        EXPECT_EQ(answer.ends_with("rn"), settings_of(e).format == 4);
      }
    }
  }
}

TEST_F(ComputerLinkStation, EveryModelTellsItsType) {
  struct Row {
    std::string_view model;
    std::string_view code;
  };
  for (const auto& row : {Row{"FX0N", "8E"}, Row{"FX1S", "F2"}, Row{"FX1N", "9E"},
                          Row{"FX2N", "9D"}, Row{"FX3G", "F4"}, Row{"FX3U", "F3"}}) {
    plc_ = make_plc(row.model);
    EXPECT_EQ(asked("PC0").substr(5, 2), row.code);
  }
}

TEST_F(ComputerLinkStation, OneMorePointThanTheLimitIsRefused) {
  struct Row {
    std::string_view model;
    std::string_view taken;
    std::string_view refused;
  };
  const std::string w64(64 * 4, '0');
  const std::string b160(160, '1');
  const auto with = [](std::string_view head, const std::string& data, std::size_t size) {
    return std::string(head) + data.substr(0, size);
  };
  std::string ten;
  for (int i = 0; i < 10; ++i) ten += "D00000001";
  std::string twenty;
  for (int i = 0; i < 20; ++i) twenty += "M00001";
  const std::array rows = {
      Row{"FX1S", "BR0M000036", "BR0M000037"}, Row{"FX1S", "WR0D00000D", "WR0D00000E"},
      Row{"FX1S", "WR0CN23506", "WR0CN23507"}, Row{"FX3U", "WR0D000040", "WR0D000041"},
      Row{"FX3U", "WR0M000020", "WR0M000021"}, Row{"FX3U", "WR0CN20020", "WR0CN20021"},
  };
  for (const auto& row : rows) {
    plc_ = make_plc(row.model);
    EXPECT_EQ(asked(row.taken)[0], '>') << row.taken;
    EXPECT_EQ(asked(row.refused), "-00FF06") << row.refused;
  }
  plc_ = make_plc("FX3U");
  EXPECT_EQ(asked(with("BW0M0000A0", b160, 160)), "+00FF");
  EXPECT_EQ(asked(with("BW0M0000A1", b160 + "1", 161)), "-00FF06");
  EXPECT_EQ(asked(with("WW0D000040", w64, 256)), "+00FF");
  EXPECT_EQ(asked(with("WW0M00000A", w64, 40)), "+00FF");
  EXPECT_EQ(asked(with("WW0M00000B", w64, 44)), "-00FF06");
  EXPECT_EQ(asked("WT00A" + ten), "+00FF");
  EXPECT_EQ(asked("WT00B" + ten + "D00000001"), "-00FF06");
  EXPECT_EQ(asked("BT014" + twenty), "+00FF");
  EXPECT_EQ(asked("BT015" + twenty + "M00001"), "-00FF06");
  plc_ = make_plc("FX0N");
  EXPECT_EQ(asked(with("BW0M00002E", b160, 46)), "+00FF");
  EXPECT_EQ(asked(with("BW0M00002F", b160, 47)), "-00FF06");
  EXPECT_EQ(asked(with("WW0D00000B", w64, 44)), "+00FF");
  EXPECT_EQ(asked(with("WW0D00000C", w64, 48)), "-00FF06");
  EXPECT_EQ(asked("WT007" + ten.substr(0, 63)), "-00FF06");
  EXPECT_EQ(asked("BT00B" + twenty.substr(0, 66)), "-00FF06");
  EXPECT_EQ(asked("TT019" + w64.substr(0, 25))[0], '>');
  EXPECT_EQ(asked("TT01A" + w64.substr(0, 26)), "-00FF06");
}

TEST_F(ComputerLinkStation, CharacterAreaThatMeansNothingIsRefused) {
  for (const std::string_view command : {
           "WR0M000401",   // head of a word is not a multiple of 8
           "WR0X000401",   // the same for octal
           "BR0X000801",   // not an octal number
           "BR0Z000001",   // unknown device
           "BR0D000001",   // not a bit device
           "WR0TS00001",   // contacts have no words
           "BR0TC00001",   // coils: not on FX
           "BR0CC00001",   //
           "WR0R000001",   // QR only
           "BR0M768001",   // past the last
           "WR0D799902",   // extends past the last
           "WR0CN19902",   // 16 and 32 bits in one request
           "WR0D000000",   // no points
           "WR0D0000G1",   // count is not hex
           "WRXD000001",   // wait is not hex
           "QR0R03276801"  // past the last
       })
    EXPECT_EQ(asked(command), "-00FF06") << command;
  EXPECT_EQ(sent("<00FFJR0"), "-00FF06");  // ends at once: its length is unknown
  plc_ = make_plc("FX2N");
  EXPECT_EQ(asked("QR0D00000001"), "-00FF06");
}

TEST_F(ComputerLinkStation, ExtensionRegistersAreReadAndWritten) {
  EXPECT_EQ(asked("QW0R03276602ABCD1234"), "+00FF");
  EXPECT_EQ(differences(plc_, "R32766=ABCD 1234"), "");
  EXPECT_EQ(asked("QR0R03276602").substr(5, 8), "ABCD1234");
  plc_ = make_plc("FX3G");
  EXPECT_EQ(asked("QR0R02399901")[0], '>');
  EXPECT_EQ(asked("QR0R02400001"), "-00FF06");
}

TEST_F(ComputerLinkStation, LongCountersAreWrittenHighWordFirstButNotInLists) {
  EXPECT_EQ(asked("WW0CN2000112345678"), "+00FF");
  EXPECT_EQ(differences(plc_, "CN200=12345678"), "");
  EXPECT_EQ(asked("WT001CN2001234"), "-00FF06");
}

TEST_F(ComputerLinkStation, SmallestOfSeveralErrorsIsSent) {
  EXPECT_EQ(sent("<00FFWR0D00000100"), "-00FF02");
  EXPECT_EQ(sent("<00FEWR0M00040100"), "-00FF02");
  EXPECT_EQ(asked("WW0D000001123G"), "-00FF07");
  EXPECT_EQ(asked("WW0D00000112a4"), "-00FF07");
  EXPECT_EQ(asked("BW0M0000022A"), "-00FF07");
  EXPECT_EQ(asked("BW0M00000112"), "-00FF02");  // the extra character is taken for the sum
}

TEST_F(ComputerLinkStation, PcNumberOtherThanFfIsRefused) {
  EXPECT_EQ(sent("<00FEWR0D000001", {.sum_check = false}), "-00FF10");
  EXPECT_EQ(sent("<00FEWR0M000401", {.sum_check = false}), "-00FF06");
}

TEST_F(ComputerLinkStation, NothingIsWrittenOfARefusedRequest) {
  EXPECT_EQ(asked("WT002D00001234M0004FFFF"), "-00FF06");
  EXPECT_EQ(asked("WW0D0000021234123G"), "-00FF07");
  EXPECT_EQ(differences(plc_, "D0=0"), "");
}

TEST_F(ComputerLinkStation, FormatFourWantsLfBehindCr) {
  EXPECT_EQ(sent("<00FFPC0rr", {.format = 4, .sum_check = false}), "-00FF03rn");
  EXPECT_EQ(sent("<00FFPC0rn", {.format = 4, .sum_check = true}), "-00FF02rn");
  EXPECT_EQ(sent("<00FFPC0C1rn", {.format = 4, .sum_check = false}), "-00FF06rn");
  EXPECT_EQ(sent("<00FFPC0", {.format = 4, .sum_check = false}), "");  // never ends
}

TEST_F(ComputerLinkStation, OtherStationsAndIncompleteRequestsAreSilence) {
  EXPECT_EQ(sent("<05FFWR0TN1230264"), "");
  EXPECT_EQ(sent("<FFFFPC0", {.sum_check = false}), "");
  EXPECT_EQ(sent("<00FFWR0D0000"), "");
  EXPECT_EQ(sent("00FFWR0D000001"), "");
}

TEST_F(ComputerLinkStation, NewEnquiryForgetsHalfARequest) {
  EXPECT_EQ(sent("<00FFWW0D000001<00FFTT005ABCDE78"), ">00FF05ABCDE|A3");
}

TEST_F(ComputerLinkStation, SilenceForgetsHalfARequest) {
  const auto link = make_computer_link({});
  const auto framer = link->make_framer();
  EXPECT_TRUE(replies_of(*link, *framer, plc_, from_marks("<00FFTT005AB")).empty());
  EXPECT_TRUE(
      replies_of(*link, *framer, plc_, from_marks("CDE78"), TimePoint{milliseconds(12 + 101)})
          .empty());
}

TEST_F(ComputerLinkStation, WordsOfTheMasterAreTakenSilently) {
  EXPECT_EQ(sent("+00FF-00FF.<00FFTT005ABCDE78+00FF"), ">00FF05ABCDE|A3");
  const auto link = make_computer_link({});
  EXPECT_EQ(link->kind({from_marks("+00FF"), true, {}}), RequestKind::handshake);
  EXPECT_FALSE(link->hears({from_marks("+05FF"), true, {}}));
  EXPECT_TRUE(link->hears({from_marks("."), true, {}}));
}

TEST_F(ComputerLinkStation, MessageWaitIsToldToTheLine) {
  const auto link = make_computer_link({});
  EXPECT_EQ(link->execute({summed("PCA"), true, {}}, plc_).wait, milliseconds(100));
  EXPECT_EQ(link->execute({summed("WRFZ000001"), true, {}}, plc_).wait, milliseconds(150));
}

TEST_F(ComputerLinkStation, RemoteRunTakesOnlyWithTheSwitchInStop) {
  EXPECT_EQ(sent("<00FFRS0C1"), "-00FF18");
  EXPECT_EQ(asked("RR0"), "-00FF18");  // already in RUN
  plc_.set_running(false);
  EXPECT_EQ(asked("RR0"), "-00FF18");  // switch in RUN
  plc_.set_run_switch(false);
  EXPECT_EQ(asked("RR0"), "+00FF");
  EXPECT_TRUE(plc_.running());
  EXPECT_EQ(differences(plc_, "M8035=1 1 0"), "");
  EXPECT_EQ(asked("RR0"), "-00FF18");
  EXPECT_EQ(asked("RS0"), "+00FF");
  EXPECT_FALSE(plc_.running());
  EXPECT_EQ(asked("RS0"), "-00FF18");
}

TEST_F(ComputerLinkStation, GlobalSignalReachesAllAndIsNotAnswered) {
  EXPECT_EQ(sent("<FFFFGW0117"), "");
  EXPECT_EQ(differences(plc_, "M8126=1"), "");
  EXPECT_EQ(asked("GW00"), "");
  EXPECT_EQ(differences(plc_, "M8126=0"), "");
  asked("GW01");
  plc_.set_running(false);
  EXPECT_EQ(differences(plc_, "M8126=0"), "");
}

TEST_F(ComputerLinkStation, KindsAreToldFromTheCommand) {
  const auto link = make_computer_link({});
  struct Row {
    std::string_view command;
    RequestKind kind;
  };
  for (const auto& row : {
           Row{"BR0M000001", RequestKind::read},
           Row{"QR0D00000001", RequestKind::read},
           Row{"WW0D0000010001", RequestKind::write},
           Row{"BW0M00000211", RequestKind::write},
           Row{"BW0M0000011", RequestKind::force_on},
           Row{"BW0M0000010", RequestKind::force_off},
           Row{"BT001Y00051", RequestKind::force_on},
           Row{"BT002Y00051M00000", RequestKind::write},
           Row{"RR0", RequestKind::control},
           Row{"GW01", RequestKind::control},
           Row{"PC0", RequestKind::other},
       })
    EXPECT_EQ(link->kind({summed(row.command), true, {}}), row.kind) << row.command;
}

TEST_F(ComputerLinkStation, FlawsLeaveTheRestAsItShouldBe) {
  const auto spoiled = [](std::string_view text, Flaw flaw, ComputerLinkSettings settings) {
    auto reply = from_marks(text);
    make_computer_link(settings)->spoil(reply, flaw);
    return with_marks(reply);
  };
  EXPECT_EQ(spoiled(">05FF01101|E7", Flaw::sum, {.station = 5}), ">05FF01101|E0");
  EXPECT_EQ(spoiled(">05FF01101|E7rn", Flaw::sum, {.station = 5, .format = 4}), ">05FF01101|E0rn");
  EXPECT_EQ(spoiled("+05FF", Flaw::sum, {.station = 5}), "\a05FF");
  EXPECT_EQ(spoiled(">05FF01101|E7rn", Flaw::sender, {.station = 5, .format = 4}),
            ">06FF01101|E8rn");
  EXPECT_EQ(spoiled(">0FFF9D|82", Flaw::sender, {.station = 15}), ">00FF9D|6C");
  EXPECT_EQ(spoiled("+05FF", Flaw::sender, {.station = 5}), "+06FF");
}

TEST_F(ComputerLinkStation, RefusalCarriesItsCode) {
  const auto link = make_computer_link({.station = 5, .format = 4});
  EXPECT_EQ(with_marks(link->refusal({summed("PC0"), true, {}}, 0x18)), "-05FF18rn");
  EXPECT_EQ(with_marks(link->refusal({summed("PC0"), true, {}}, std::nullopt)), "-05FF06rn");
}

}  // namespace
}  // namespace fxsim
