#include "tests/sim/station.h"

#include <gtest/gtest.h>

#include "tests/sim/computer_link.h"
#include "tests/sim/modbus.h"
#include "tests/sim/programming_port.h"
#include "tests/sim/sample_plc.h"

namespace fxsim {
namespace {

using std::chrono::milliseconds;

const Frame kEnquiry{{0x05}, true, {}};
// D123 = 1234h, D124 = ABCDh; read D123 and D124.
const Frame kWrite{*from_hex("02 31 31 30 46 36 30 34 33 34 31 32 43 44 41 42 03 34 39"), true, {}};
const Frame kRead{*from_hex("02 30 31 30 46 36 30 34 03 37 34"), true, {}};
const Frame kForce{*from_hex("02 37 36 34 30 38 03 30 43"), true, {}};  // M100 ON
constexpr std::string_view kData = "02 30 30 30 30 30 30 30 30 03 38 33";

class StationTest : public testing::Test {
 protected:
  void add(Fault fault) { station_.faults().add(fault); }
  Answer ask(const Frame& frame) { return station_.answer(frame, now_ += milliseconds(10)); }
  /// Returns all bytes sent for `frame`.
  std::string sent(const Frame& frame) {
    Bytes all;
    for (const auto& piece : ask(frame).pieces)
      all.insert(all.end(), piece.bytes.begin(), piece.bytes.end());
    return to_hex(all);
  }
  std::uint32_t d123() { return station_.plc().memory().get({Kind::d, 123}); }

  TimePoint now_{};
  Station station_{"p1",
                   make_programming_port(),
                   make_plc(),
                   TimePoint{},
                   std::chrono::system_clock::time_point(milliseconds(1'790'000'000'000)),
                   {}};
};

using Faulted = StationTest;

TEST_F(Faulted, NakIsNotCarriedOut) {
  add({.kind = FaultKind::nak});
  EXPECT_EQ(sent(kWrite), "15");
  EXPECT_EQ(d123(), 0U);
  EXPECT_EQ(station_.stats().naks, 1U);
  EXPECT_EQ(sent(kWrite), "06");
  EXPECT_EQ(d123(), 0x1234U);
}

TEST_F(Faulted, WrongSumSpoilsOneDigit) {
  EXPECT_EQ(sent(kRead), kData);
  add({.kind = FaultKind::wrong_sum});
  EXPECT_EQ(sent(kRead), "02 30 30 30 30 30 30 30 30 03 38 30");
}

TEST_F(Faulted, WrongSumOfAnAckIsAnotherByteAndTheWriteIsDone) {
  add({.kind = FaultKind::wrong_sum});
  EXPECT_EQ(sent(kWrite), "07");
  EXPECT_EQ(d123(), 0x1234U);
}

TEST_F(Faulted, TruncatedEndsEarly) {
  add({.kind = FaultKind::truncated});
  EXPECT_EQ(sent(kRead), "02 30 30 30 30 30");
  add({.kind = FaultKind::truncated, .bytes = 11});
  EXPECT_EQ(sent(kRead), "02 30 30 30 30 30 30 30 30 03 38");
}

TEST_F(Faulted, LateIsCarriedOutAtOnce) {
  add({.kind = FaultKind::late, .delay = milliseconds(700)});
  const auto answer = ask(kWrite);
  ASSERT_EQ(answer.pieces.size(), 1U);
  EXPECT_EQ(answer.pieces[0].pause, milliseconds(700));
  EXPECT_EQ(d123(), 0x1234U);
}

TEST_F(Faulted, SilentDoesNothing) {
  add({.kind = FaultKind::silent});
  EXPECT_EQ(sent(kWrite), "");
  EXPECT_EQ(d123(), 0U);
}

TEST_F(Faulted, ExecuteThenSilentDoesIt) {
  add({.kind = FaultKind::execute_then_silent});
  EXPECT_EQ(sent(kWrite), "");
  EXPECT_EQ(d123(), 0x1234U);
  EXPECT_EQ(station_.stats().accepted_writes, 1U);
}

TEST_F(Faulted, OtherBytesComeBeforeAndAfter) {
  add({.kind = FaultKind::garbage_before, .other = {0x7F, 0x00}});
  add({.kind = FaultKind::noise_after, .other = {0x03}});
  EXPECT_EQ(sent(kEnquiry), "7F 00 06 03");
}

TEST_F(Faulted, EchoComesUnpacedAheadOfTheReply) {
  add({.kind = FaultKind::echo});
  const auto answer = ask(kRead);
  ASSERT_EQ(answer.pieces.size(), 2U);
  EXPECT_EQ(answer.pieces[0].bytes, kRead.bytes);
  EXPECT_FALSE(answer.pieces[0].paced);
  EXPECT_EQ(to_hex(answer.pieces[1].bytes), kData);
}

TEST_F(Faulted, SplitComesInPieces) {
  add({.kind = FaultKind::split, .delay = milliseconds(30), .bytes = 5});
  const auto answer = ask(kRead);
  ASSERT_EQ(answer.pieces.size(), 3U);
  EXPECT_EQ(to_hex(answer.pieces[0].bytes), "02 30 30 30 30");
  EXPECT_EQ(answer.pieces[0].pause, milliseconds(0));
  EXPECT_EQ(to_hex(answer.pieces[2].bytes), "38 33");
  EXPECT_EQ(answer.pieces[2].pause, milliseconds(30));
}

TEST_F(Faulted, DropIsNotCarriedOut) {
  add({.kind = FaultKind::drop, .delay = milliseconds(50)});
  const auto answer = ask(kWrite);
  EXPECT_EQ(answer.hang_up, milliseconds(50));
  EXPECT_TRUE(answer.pieces.empty());
  EXPECT_EQ(d123(), 0U);
}

TEST_F(Faulted, DropAfterTheDeedIsBothFaultsTogether) {
  add({.kind = FaultKind::drop});
  add({.kind = FaultKind::execute_then_silent});
  EXPECT_TRUE(ask(kWrite).hang_up.has_value());
  EXPECT_EQ(d123(), 0x1234U);
}

TEST_F(Faulted, PlcStoppedStopsAndAnswers) {
  add({.kind = FaultKind::plc_stopped});
  EXPECT_EQ(sent(kWrite), "06");
  EXPECT_FALSE(station_.plc().running());
}

TEST_F(Faulted, DeadLastsUntilCleared) {
  add({.kind = FaultKind::dead, .count = -1});
  add({.kind = FaultKind::execute_then_silent, .count = -1});
  add({.kind = FaultKind::echo, .count = -1});
  for (int i = 0; i < 5; ++i) EXPECT_EQ(sent(kWrite), "");
  EXPECT_EQ(d123(), 0U);
  EXPECT_TRUE(station_.faults().dead());
  station_.faults().clear();
  EXPECT_EQ(sent(kWrite), "06");
}

TEST_F(Faulted, MatchPicksTheRequests) {
  struct Row {
    FaultMatch match;
    std::string answers;  // one letter each for ENQ, read, write, force; . if refused
  };
  for (const auto& row : {Row{FaultMatch::any, "...."}, Row{FaultMatch::enquire, ".rwf"},
                          Row{FaultMatch::read, "e.wf"}, Row{FaultMatch::write, "er.f"},
                          Row{FaultMatch::force, "erw."}}) {
    station_.faults().clear();
    add({.kind = FaultKind::nak, .match = row.match, .count = -1});
    std::string answers;
    for (const auto& [letter, frame] :
         {std::pair{'e', kEnquiry}, {'r', kRead}, {'w', kWrite}, {'f', kForce}})
      answers += sent(frame) == "15" ? '.' : letter;
    EXPECT_EQ(answers, row.answers);
  }
}

TEST_F(Faulted, CountAndEveryAreKept) {
  add({.kind = FaultKind::nak, .count = 2, .every = 3});
  std::string answers;
  for (int i = 0; i < 10; ++i) answers += sent(kEnquiry) == "15" ? 'N' : 'A';
  EXPECT_EQ(answers, "AANAANAAAA");
  EXPECT_EQ(station_.stats().faults[static_cast<std::size_t>(FaultKind::nak)], 2U);
}

TEST_F(Faulted, ProbabilityIsTheSameForTheSameSeed) {
  std::array<std::string, 2> answers;
  for (auto& answer : answers) {
    station_.faults().clear();
    add({.kind = FaultKind::nak, .count = -1, .probability = 0.25, .seed = 7});
    for (int i = 0; i < 400; ++i) answer += sent(kEnquiry) == "15" ? 'N' : 'A';
  }
  EXPECT_EQ(answers[0], answers[1]);
  const auto naks = std::count(answers[0].begin(), answers[0].end(), 'N');
  EXPECT_GT(naks, 70);
  EXPECT_LT(naks, 130);
}

TEST_F(Faulted, NonsenseUsesUpNoFault) {
  add({.kind = FaultKind::nak});
  EXPECT_EQ(sent(Frame{{'A', 'B'}, false, {}}), "");
  EXPECT_EQ(sent(kEnquiry), "15");
}

TEST_F(StationTest, DeedsCarryIndexTimeDeviceAndValues) {
  ask(kEnquiry);
  ask(kWrite);
  ask(Frame{*from_hex("02 31 31 30 46 36 30 34 33 34 31 32 43 44 41 42 03 30 30"), true, {}});
  ask(kForce);
  ask(kRead);
  const auto deeds = station_.deeds(1);
  ASSERT_EQ(deeds.size(), 3U);  // the request with the wrong sum is not a deed
  EXPECT_EQ(deeds[0].index, 1U);
  EXPECT_EQ(deeds[0].unix_ms, 1'790'000'000'020);
  EXPECT_EQ(deeds[0].kind, RequestKind::write);
  EXPECT_EQ(deeds[0].device, "D123");
  EXPECT_EQ(deeds[0].count, 2U);
  EXPECT_EQ(deeds[0].values, (std::vector<std::uint32_t>{0x1234, 0xABCD}));
  EXPECT_EQ(deeds[1].kind, RequestKind::force_on);
  EXPECT_EQ(deeds[1].device, "M100");
  EXPECT_EQ(deeds[2].kind, RequestKind::read);
  EXPECT_EQ(deeds[2].device, "D123");
  EXPECT_EQ(station_.stats().accepted_writes, 2U);
  EXPECT_EQ(station_.stats().naks, 1U);
}

TEST_F(StationTest, OldReadsAreForgottenBeforeAnyWrite) {
  ask(kWrite);
  for (int i = 0; i < 1500; ++i) ask(kRead);
  const auto deeds = station_.deeds(0);
  EXPECT_EQ(deeds.size(), 1001U);
  EXPECT_EQ(deeds.front().kind, RequestKind::write);
  EXPECT_EQ(deeds.back().index, 1500U);
}

/// Returns the bytes that `station` sends for `request`, as hex.
std::string sent_by(Station& station, const Frame& request) {
  Bytes all;
  for (const auto& piece : station.answer(request, TimePoint{}).pieces)
    all.insert(all.end(), piece.bytes.begin(), piece.bytes.end());
  return to_hex(all);
}

Station modbus_tcp_station() {
  return {"m1",
          make_modbus(Protocol::modbus_tcp, {}),
          Plc(modbus_model(), make_plant("none"), TimePoint{}),
          TimePoint{},
          {},
          {}};
}
const Frame kModbusWrite{*from_hex("00 07 00 00 00 06 01 06 00 05 00 2A"), true, {}};

TEST(FaultedModbus, ExceptionCarriesItsCodeAndIsNotCarriedOut) {
  auto station = modbus_tcp_station();
  station.faults().add({.kind = FaultKind::exception, .code = 6});
  EXPECT_EQ(sent_by(station, kModbusWrite), "00 07 00 00 00 03 01 86 06");
  station.faults().add({.kind = FaultKind::nak});
  EXPECT_EQ(sent_by(station, kModbusWrite), "00 07 00 00 00 03 01 86 04");
  EXPECT_EQ(station.plc().memory().get({Kind::holding_register, 5}), 0U);
  EXPECT_EQ(station.stats().naks, 2U);
}

TEST(FaultedModbus, FlawsAreCarriedOutAndAddUp) {
  auto station = modbus_tcp_station();
  station.faults().add({.kind = FaultKind::wrong_id});
  station.faults().add({.kind = FaultKind::wrong_unit});
  EXPECT_EQ(sent_by(station, kModbusWrite), "00 06 00 00 00 06 02 06 00 05 00 2A");
  station.faults().add({.kind = FaultKind::bad_length});
  EXPECT_EQ(sent_by(station, kModbusWrite), "00 07 00 00 FF FF 01 06 00 05 00 2A");
  EXPECT_EQ(station.plc().memory().get({Kind::holding_register, 5}), 42U);
  const auto deeds = station.deeds(0);
  ASSERT_EQ(deeds.size(), 2U);
  EXPECT_EQ(deeds[0].device, "hr:5");
  EXPECT_EQ(deeds[0].values, std::vector<std::uint32_t>{42});
}

TEST(FaultedComputerLink, NakCarriesItsCodeAndTheMastersAckUsesUpNothing) {
  Station station("l1", make_computer_link({.station = 5}), make_plc("FX2N"), TimePoint{}, {}, {});
  const Frame read{*from_hex("05 30 35 46 46 42 52 41 58 30 30 34 30 30 35 34 37"), true, {}};
  const Frame ack{*from_hex("06 30 35 46 46"), true, {}};
  station.faults().add({.kind = FaultKind::nak, .code = 2});
  EXPECT_EQ(sent_by(station, ack), "");
  EXPECT_EQ(sent_by(station, read), "15 30 35 46 46 30 32");
  EXPECT_EQ(station.answer(read, TimePoint{}).wait, milliseconds(100));
  station.faults().add({.kind = FaultKind::wrong_station});
  EXPECT_EQ(sent_by(station, read), "02 30 36 46 46 30 30 30 30 30 03 45 35");
}

TEST(StationMemory, QuestionsKeptAreAsManyAsAsked) {
  Station station("p1", make_programming_port(), make_plc(), TimePoint{}, {}, {}, 5);
  for (int i = 0; i < 8; ++i) sent_by(station, kRead);
  EXPECT_EQ(station.deeds(0).size(), 5U);
}

}  // namespace
}  // namespace fxsim
