#include "agent/field/bus/bus.h"

#include <gtest/gtest.h>

#include <asio/post.hpp>

#include "protocol/catalog.h"
#include "protocol/fx/computer_link.h"
#include "tests/agent/field/field_plant.h"
#include "tests/agent/field/late_wire.h"
#include "tests/agent/field/port_frames.h"
#include "tests/agent/field/scripted_bus.h"
#include "tests/support/says.h"

namespace fxagent::test {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;
using Clock = std::chrono::steady_clock;
using Outcome = Exchange::Outcome;

const Bytes kReadD100 = read_frame(kD100, 2);
const Bytes kReadD200 = read_frame(kD200, 2);
const Bytes kWriteD200 = write_frame(kD200, word(50));
const Bytes kProbe = read_frame(kM8000, 1);
const Bytes kProbeAnswer = data_frame({0x01});
// The next probe after one that failed.
const Bytes kNextProbe = read_frame(kM8000, 2);
const Bytes kNextProbeAnswer = data_frame({0x01, 0x00});

/// One line with one PLC on the programming port.
struct BusTest : ScriptedBusTest {
  BusTest() {
    make_bus();
    station.codec = codec;
  }
  /// The station becomes one of a computer link. Returns the read of its D100.
  Read over_computer_link() {
    station.codec = codec = std::make_shared<fx::ComputerLink>(fx::ComputerLink::Settings{});
    return {codec->addresses().parse_address("D100", {})->span, fx::ComputerLink::kWordWay};
  }
  /// Reads D100 without an enquiry; a second answer follows the right one.
  void read_with_another_answer_behind() {
    station.enquire = EnquirePolicy::never;
    wire->expect(kReadD100).give(word_frame(1));
    open();
    EXPECT_TRUE(read("D100").is_data());
    wire->give(word_frame(99));
  }
  /// Scripts one exchange on a doubted bus: silence, a distinguishable request, silence.
  void script_doubted(const Bytes& question, const Bytes& answer) {
    wire->silence();
    wire->expect(kProbe).give(kProbeAnswer);
    wire->expect(question).give(answer).silence();
  }
  Exchange write_d200(unsigned value = 50) {
    return ask(Write{codec->addresses().parse_address("D200", {})->span, word(value)});
  }

  std::shared_ptr<const Codec> codec = port_codec();
};

// ---- a stream with numbered answers ------------------------------------------------------------

TEST_F(BusTest, AnswerThatIsBrokenOffByItsDeadlineTakesItsConnectionWithIt) {
  station.codec = codec_of("modbus-tcp");
  const Bytes answer = *from_hex("00 01 00 00 00 05 01 03 02 00 07");
  wire->expect(*from_hex("00 01 00 00 00 06 01 03 00 00 00 01"));
  wire->give({answer.begin(), answer.begin() + 6}).silence();
  open();
  const Request request{Read{station.codec->addresses().parse_address("hr:0", {})->span}};
  EXPECT_EQ(ask(request).outcome, Outcome::unanswered);
  EXPECT_FALSE(bus->is_open()) << "the rest would stand before the next answer";
  EXPECT_TRUE(bus->channel().closed_after_silence()) << "which is no loss";
  open();
  EXPECT_FALSE(bus->channel().closed_after_silence());
  wire->expect(*from_hex("00 02 00 00 00 06 01 03 00 00 00 01")).silence();
  EXPECT_EQ(ask(request).outcome, Outcome::unanswered);
  EXPECT_TRUE(bus->is_open()) << "nothing of an answer has come";
}

// ---- the plain case ----------------------------------------------------------------------------

TEST_F(BusTest, EnquiresOnceAfterOpeningAndThenJustAsks) {
  wire->expect(kEnq).give(kAck);
  wire->expect(kReadD100).give(word_frame(234));
  wire->expect(kReadD100).give(word_frame(235));
  open();
  const Exchange first = read("D100");
  EXPECT_TRUE(first.is_data());
  EXPECT_TRUE(first.sent);
  EXPECT_EQ(first.reply.image, word(234));
  EXPECT_LE(first.began, first.ended);
  EXPECT_GT(first.ended_ms, 0);
  EXPECT_EQ(read("D100").reply.image, word(235));
}

TEST_F(BusTest, EnquiresAgainAfterTheNextOpening) {
  wire->expect(kEnq).give(kAck).expect(kReadD100).give(word_frame(1));
  wire->expect(kEnq).give(kAck).expect(kReadD100).give(word_frame(2));
  open();
  EXPECT_TRUE(read("D100").is_data());
  bus->close();
  open();
  EXPECT_TRUE(read("D100").is_data());
}

TEST_F(BusTest, EnquiresBeforeEachRequestWhereThePolicySaysAlways) {
  station.enquire = EnquirePolicy::always;
  for (unsigned i = 0; i < 2; ++i)
    wire->expect(kEnq).give(kAck).expect(kReadD100).give(word_frame(i));
  open();
  EXPECT_TRUE(read("D100").is_data());
  EXPECT_TRUE(read("D100").is_data());
}

struct BusWithoutEnquiry : BusTest {
  BusWithoutEnquiry() { station.enquire = EnquirePolicy::never; }
};

TEST_F(BusWithoutEnquiry, NeverEnquiresWhereThePolicySaysNever) {
  wire->expect(kReadD100).give(word_frame(1)).expect(kReadD100).give(word_frame(2));
  open();
  EXPECT_TRUE(read("D100").is_data());
  EXPECT_TRUE(read("D100").is_data());
}

TEST_F(BusTest, ReplyMayComeInPieces) {
  const Bytes reply = word_frame(0x15AB);
  for (std::size_t cut = 1; cut < reply.size(); ++cut) {
    wire->expect(kReadD100).give({reply.begin(), reply.begin() + static_cast<long>(cut)});
    wire->give({reply.begin() + static_cast<long>(cut), reply.end()});
  }
  station.enquire = EnquirePolicy::never;
  open();
  for (std::size_t cut = 1; cut < reply.size(); ++cut)
    EXPECT_EQ(read("D100").reply.image, word(0x15AB)) << "cut after " << cut;
}

TEST_F(BusTest, EchoOfTheRequestIsNoAnswer) {
  wire->expect(kEnq).give(joined(kEnq, kAck));
  wire->expect(kReadD100).give(kReadD100).give(word_frame(7));
  wire->expect(kWriteD200).give(joined(kWriteD200, kAck));
  open();
  EXPECT_EQ(read("D100").reply.image, word(7));
  EXPECT_TRUE(write_d200().is_ack());
}

TEST_F(BusTest, EchoAloneIsSilence) {
  wire->expect(kEnq).give(kAck).expect(kReadD100).give(kReadD100);
  open();
  EXPECT_EQ(read("D100").outcome, Outcome::unanswered);
}

TEST_F(BusTest, EchoThatTheLineIsSaidToReturnIsTakenOff) {
  station.echo = true;
  wire->expect(kEnq).give(kEnq).give(kAck);
  wire->expect(kWriteD200).give(Bytes{0x00}).give(kWriteD200).give(kAck);
  wire->expect(kWriteD200).give(kWriteD200).silence();  // an echo is not an answer
  open();
  EXPECT_TRUE(write_d200().is_ack());
  const Exchange unanswered = write_d200();
  EXPECT_EQ(unanswered.outcome, Outcome::unanswered);
  EXPECT_EQ(unanswered.error.find("echo"), std::string::npos);
}

TEST_F(BusTest, EchoThatDoesNotComeIsNamed) {
  station.echo = true;
  station.enquire = EnquirePolicy::never;
  wire->expect(kReadD100).give(word_frame(234)).silence();
  open();
  const Exchange answer = read("D100");
  EXPECT_EQ(answer.outcome, Outcome::unanswered);
  expect_says(answer.error, "not even the echo");
}

TEST_F(BusWithoutEnquiry, EchoThatNobodyToldOfIsFoundByThreeReads) {
  const Bytes data = word_frame(234);
  for (int i = 0; i < 3; ++i) wire->expect(kReadD100).give(kReadD100).give(data);
  wire->expect(kWriteD200).give(kWriteD200).give(kAck);
  wire->expect(kReadD100).give(data);
  open();
  for (int i = 0; i < 3; ++i) {
    EXPECT_FALSE(bus->echo_found());
    EXPECT_TRUE(read("D100").is_data());
  }
  EXPECT_TRUE(bus->echo_found());
  EXPECT_TRUE(write_d200().is_ack());
  EXPECT_TRUE(read("D100").is_data()) << "a read without an echo is a read";
  EXPECT_FALSE(bus->echo_found());
}

TEST_F(BusTest, EchoOfWhatNobodyAnswersIsFoundToo) {
  // A computer link sends an EOT first and an ACK after each answer. Their echoes come before the
  // echo of the next request.
  const Read d100 = over_computer_link();
  const Bytes eot = *codec->encode(*codec->resync(), 0);
  const Bytes question = *codec->encode(d100, 0);
  const LinkDialect plc(/*ends_with_cr_lf=*/false);
  const Bytes answer = plc.data(plc.understand(question), 234);
  const Bytes ack{0x06, '0', '0', 'F', 'F'};
  wire->expect(eot).expect(question).give(joined(eot, question)).give(answer).expect(ack);
  for (int i = 0; i < 2; ++i)
    wire->expect(question).give(joined(ack, question)).give(answer).expect(ack);
  open();
  for (int i = 0; i < 3; ++i) {
    EXPECT_FALSE(bus->echo_found());
    EXPECT_EQ(ask(d100).reply.image, word(234));
  }
  EXPECT_TRUE(bus->echo_found());
  EXPECT_FALSE(bus->doubt().is_doubted());
  EXPECT_EQ(bus->counters().unexpected_bytes, 0U);
}

TEST_F(BusTest, OnALineThatReturnsNothingTheLastFrameIsNoEcho) {
  // The answer to a Modbus write equals the request: a second one is as foreign as any other.
  station.codec = codec_of("modbus-rtu");
  const Bytes question = *from_hex("01 03 00 00 00 02 C4 0B");
  const Bytes admitted = *from_hex("01 06 00 01 00 AA 58 75");
  wire->expect(question).give(*from_hex("01 03 04 00 64 00 65 7B C7"));
  wire->expect(admitted).give(admitted).give(admitted);
  open();
  const std::uint16_t space = station.codec->addresses().parse_address("hr:0", {})->span.space;
  EXPECT_TRUE(ask(Read{{space, 0, 32}}).is_data());
  EXPECT_EQ(ask(Write{{space, 16, 16}, word(0xAA)}).outcome, Outcome::garbled);
  EXPECT_TRUE(bus->doubt().is_doubted());
}

TEST_F(BusTest, EchoThatWasFoundAndCeasesMakesNoDeviceSilentForEver) {
  const Bytes data = word_frame(234);
  wire->expect(kEnq).give(joined(kEnq, kAck));
  for (int i = 0; i < 3; ++i) wire->expect(kReadD100).give(kReadD100).give(data);
  wire->expect(kReadD100).silence();
  wire->expect(kEnq).give(kAck).expect(kReadD100).give(data);
  open();
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(read("D100").is_data());
  EXPECT_TRUE(bus->echo_found());
  EXPECT_EQ(read("D100").outcome, Outcome::unanswered);
  EXPECT_TRUE(read("D100").is_data()) << "behind an enquiry that nothing echoes";
  EXPECT_FALSE(bus->echo_found());
}

TEST_F(BusTest, NoiseBeforeTheReplyIsPassedOver) {
  wire->expect(kEnq).give({0x00, 0xFF, 0x06});
  wire->expect(kReadD100).give(joined({0xFF, 0x7F, 0x00}, word_frame(7)));
  open();
  EXPECT_EQ(read("D100").reply.image, word(7));
}

TEST_F(BusTest, NakIsAnAnswer) {
  wire->expect(kEnq).give(kAck).expect(kWriteD200).give(kNak).expect(kReadD100).give(word_frame(1));
  open();
  const Exchange refused = write_d200();
  EXPECT_TRUE(refused.is_nak());
  EXPECT_TRUE(refused.sent);
  EXPECT_TRUE(read("D100").is_data()) << "nothing to clear up after a NAK";
}

// ---- silent and noisy lines --------------------------------------------------------------------

TEST_F(BusTest, EnquiryThatNobodyAnswersSendsNothingElse) {
  wire->expect(kEnq);
  open();
  const Exchange exchange = write_d200();
  EXPECT_EQ(exchange.outcome, Outcome::unanswered);
  EXPECT_FALSE(exchange.sent) << "the command has not left";
  EXPECT_FALSE(exchange.error.empty());
  EXPECT_EQ(wire->written().size(), 1U);
}

TEST_F(BusTest, DrainsAndEnquiresAfterASilence) {
  wire->expect(kEnq).give(kAck);
  wire->expect(kReadD100).silence();
  wire->silence();  // the drain: quiet
  wire->expect(kEnq).give(kAck).expect(kReadD100).give(word_frame(7));
  open();
  const Exchange silent = read("D100");
  EXPECT_EQ(silent.outcome, Outcome::unanswered);
  EXPECT_TRUE(silent.sent);
  EXPECT_EQ(read("D100").reply.image, word(7));
}

TEST_F(BusTest, LateReplyIsNotTakenForTheNextAnswer) {
  // Both replies have the same shape; only their order distinguishes them.
  wire->expect(kEnq).give(kAck);
  wire->expect(kReadD100).silence();
  wire->give(word_frame(1)).silence();                   // it arrives during the drain
  wire->expect(kEnq).give(joined(word_frame(1), kAck));  // or after the enquiry
  for (int i = 0; i < 2; ++i) wire->expect(kReadD200).give(word_frame(2));
  open();
  EXPECT_EQ(read("D100").outcome, Outcome::unanswered);
  EXPECT_EQ(read("D200").reply.image, word(2));
}

TEST_F(BusTest, LateReplyBetweenDrainAndEnquiryIsThrownAway) {
  wire->expect(kEnq).give(kAck);
  wire->expect(kReadD100).silence();
  wire->silence().give(joined(word_frame(1), kNak));
  wire->expect(kEnq).give(kAck);
  for (int i = 0; i < 2; ++i) wire->expect(kReadD200).give(word_frame(2));
  open();
  EXPECT_EQ(read("D100").outcome, Outcome::unanswered);
  EXPECT_EQ(read("D200").reply.image, word(2));
}

TEST_F(BusTest, LineIsInUseUntilTheAckOfAnAnswerHasLeft) {
  constexpr auto kCharTime = milliseconds(20);
  make_bus(kCharTime);
  const Read d100 = over_computer_link();
  const Bytes question = *codec->encode(d100, 0);
  const LinkDialect plc(/*ends_with_cr_lf=*/false);
  const Bytes ack{0x06, '0', '0', 'F', 'F'};
  wire->expect(*codec->encode(*codec->resync(), 0));
  wire->expect(question).give(plc.data(plc.understand(question), 234)).expect(ack);
  open();
  const auto before = bus->counters().busy;
  const Exchange exchange = ask(d100);
  EXPECT_TRUE(exchange.is_data());
  EXPECT_GE(bus->counters().busy - before, exchange.ended - exchange.began + 5 * kCharTime);
}

TEST_F(BusTest, LateReplyHasItsTimeWhereNobodyAnswersTheResync) {
  // The EOT of a computer link has no answer that could separate earlier bytes from later ones.
  station.timeout = milliseconds(150);
  const Read d100 = over_computer_link();
  const Bytes question = *codec->encode(d100, 0);
  const Bytes eot = *codec->encode(*codec->resync(), 0);
  wire->expect(eot).expect(question).silence();
  wire->hang();  // the drain; on a real line it runs to its end
  wire->expect(eot).expect(question).silence();
  open();
  const Exchange first = ask(d100);
  const Exchange second = ask(d100);
  EXPECT_EQ(first.outcome, Outcome::unanswered);
  EXPECT_GE(second.began - first.ended, station.timeout);
}

TEST_F(BusTest, LateAckIsNotTakenForTheAckOfTheNextWrite) {
  // The write's ACK arrives so late that it is read as the answer to the enquiry; the enquiry's own
  // ACK could then be read as the answer to the next write. An ACK cannot answer the read between
  // them, and any bytes before its data are older.
  wire->expect(kEnq).give(kAck);
  wire->expect(kWriteD200).silence();
  wire->silence();
  wire->expect(kEnq).give(kAck);                          // really the write's ACK
  wire->expect(kProbe).give(joined(kAck, kProbeAnswer));  // the enquiry's ACK, then the data
  wire->expect(write_frame(kD200, word(60))).silence();   // never acknowledged
  open();
  EXPECT_EQ(write_d200(50).outcome, Outcome::unanswered);
  EXPECT_EQ(write_d200(60).outcome, Outcome::unanswered);
}

TEST_F(BusWithoutEnquiry, LateAckIsNotTakenForAnotherWithoutAnEnquiryEither) {
  wire->expect(kWriteD200).silence();
  wire->silence();
  wire->expect(kProbe).give(joined(kAck, kProbeAnswer));
  wire->expect(write_frame(kD200, word(60))).silence();
  open();
  EXPECT_EQ(write_d200(50).outcome, Outcome::unanswered);
  EXPECT_EQ(write_d200(60).outcome, Outcome::unanswered);
}

TEST_F(BusWithoutEnquiry, LateNakIsNotTakenForTheProbesAnswer) {
  wire->expect(kWriteD200).silence();
  wire->silence();  // the drain
  wire->expect(kProbe).give(kNak).expect(kNextProbe).give(kNextProbeAnswer);
  wire->expect(kWriteD200).give(kAck);
  open();
  EXPECT_EQ(write_d200().outcome, Outcome::unanswered);
  EXPECT_TRUE(write_d200().is_ack());
}

TEST_F(BusWithoutEnquiry, ReadsNakIsNotTakenForTheAnswerToAWriteHoweverLate) {
  wire->expect(kReadD100).silence();
  wire->silence();  // the drain
  wire->expect(kProbe).give(kNak).expect(kNextProbe).give(kNextProbeAnswer);
  wire->expect(kWriteD200).give(kAck);
  open();
  EXPECT_EQ(read("D100").outcome, Outcome::unanswered);
  EXPECT_TRUE(write_d200().is_ack());
}

TEST_F(BusWithoutEnquiry, DeviceThatRefusesTheProbeForeverIsAskedAllTheSame) {
  wire->expect(kWriteD200).silence();
  wire->silence();
  for (unsigned i = 1; i <= 3; ++i) wire->expect(read_frame(kM8000, i)).give(kNak);
  wire->expect(kWriteD200).give(kAck);
  open();
  EXPECT_EQ(write_d200().outcome, Outcome::unanswered);
  EXPECT_TRUE(write_d200().is_ack());
}

TEST_F(BusTest, LostAckStaysAWorryUntilAReadWasAnswered) {
  wire->expect(kEnq).give(kAck);
  wire->expect(kWriteD200).silence();
  wire->expect(kEnq).give(kAck).expect(kProbe).silence();  // no barrier yet
  wire->expect(kEnq)
      .give(kAck)
      .expect(kNextProbe)
      .give(kNextProbeAnswer)
      .expect(kReadD100)
      .give(word_frame(1));
  wire->expect(kWriteD200).give(kAck);  // the doubt is resolved
  open();
  EXPECT_EQ(write_d200().outcome, Outcome::unanswered);
  const Exchange unsure = read("D100");
  EXPECT_EQ(unsure.outcome, Outcome::unanswered);
  EXPECT_FALSE(unsure.sent);
  EXPECT_TRUE(read("D100").is_data());
  EXPECT_TRUE(write_d200().is_ack());
}

TEST_F(BusTest, LateAckIsNotTakenForAnotherAfterAReconnection) {
  // A serial server delivers the PLC's last bytes to whichever client is connected now.
  wire->expect(kEnq).give(kAck);
  wire->expect(kWriteD200).hang_up();
  wire->silence();                                        // quiet after opening; then arrive:
  wire->expect(kEnq).give(kAck);                          // the lost write's ACK
  wire->expect(kProbe).give(joined(kAck, kProbeAnswer));  // the enquiry's
  wire->expect(write_frame(kD200, word(60))).silence();
  open();
  EXPECT_EQ(write_d200(50).outcome, Outcome::link_down);
  open();
  EXPECT_EQ(write_d200(60).outcome, Outcome::unanswered);
}

TEST_F(BusTest, BadSumIsGarbledAndTheLineIsPutInOrder) {
  Bytes wrong = word_frame(7);
  wrong.back() = wrong.back() == '0' ? '1' : '0';
  wire->expect(kEnq).give(kAck).expect(kReadD100).give(wrong);
  wire->expect(kEnq).give(kAck).expect(kReadD100).give(word_frame(7));
  open();
  const Exchange garbled = read("D100");
  EXPECT_EQ(garbled.outcome, Outcome::garbled);
  expect_says(garbled.error, "sum");
  EXPECT_EQ(read("D100").reply.image, word(7));
}

TEST_F(BusTest, BabblingLineEndsTheExchange) {
  wire->expect(kEnq).give(kAck).expect(kReadD100);
  for (int i = 0; i < 9; ++i) wire->give(Bytes(512, 0x55));
  open();
  EXPECT_EQ(read("D100").outcome, Outcome::garbled);
  wire->discard_input();
}

TEST_F(BusTest, NoiseAroundAnAnswerIsThrownAwayAndCounted) {
  wire->expect(kEnq).give(kAck);
  wire->expect(kReadD100).give(joined(word_frame(1), {0x55, 0x55}));
  wire->hang();  // would block any further read
  wire->expect(kReadD100).give(word_frame(2));
  open();
  EXPECT_EQ(read("D100").reply.image, word(1));
  EXPECT_EQ(wire->steps_left(), 3U) << "nobody listens behind an answer that is not in doubt";
  wire->skip();
  const Exchange second = read("D100");
  EXPECT_EQ(second.reply.image, word(2));
  EXPECT_FALSE(second.doubted);
  EXPECT_EQ(bus->counters().unexpected_bytes, 2U);
  EXPECT_EQ(to_hex(bus->last_unexpected()), "55 55");
  EXPECT_FALSE(bus->doubt().is_doubted()) << "no answer is made of these";
}

TEST_F(BusTest, WhatAnEarlierSessionLeftRunsDryOnOpening) {
  wire->give(word_frame(99)).give(kAck).silence();
  wire->expect(kEnq).give(kAck).expect(kReadD100).give(word_frame(2));
  open();
  EXPECT_EQ(read("D100").reply.image, word(2));
}

TEST_F(BusTest, ListensBeforeTheFirstQuestionOfEachSession) {
  make_bus(nanoseconds(0), milliseconds(120));
  station.enquire = EnquirePolicy::never;
  for (unsigned session = 1; session <= 2; ++session) {
    wire->later(word_frame(99)).hang();  // the answer to an earlier client
    wire->expect(kReadD100).give(word_frame(session));
    const auto before = Clock::now();
    open();
    const Exchange first = read("D100");
    EXPECT_EQ(first.reply.image, word(session));
    EXPECT_GE(first.began - before, milliseconds(120));
    bus->close();
  }
  EXPECT_FALSE(bus->doubt().is_doubted()) << "a dead agent's answer is no sign of another master";
}

TEST_F(BusWithoutEnquiry, TimeThatHasPassedSinceASilenceNeedNotBeListenedToAgain) {
  station.timeout = milliseconds(300);
  open();
  // A busy machine may delay any single attempt. Without the credit, every attempt would wait for
  // the full timeout.
  Clock::duration least = std::chrono::hours(1);
  for (int i = 0; i < 5 && least >= station.timeout; ++i) {
    wire->expect(kReadD100).silence();
    const Exchange silent = read("D100");
    while (Clock::now() < silent.ended + milliseconds(250)) {
    }
    const auto asked = Clock::now();
    wire->hang().expect(kReadD100).give(word_frame(2));
    const Exchange second = read("D100");
    EXPECT_GE(second.began - asked, milliseconds(100)) << "it listens for 100 ms all the same";
    least = std::min<Clock::duration>(least, second.began - asked);
  }
  EXPECT_LT(least, station.timeout);
}

// ---- unexpected answers ------------------------------------------------------------------------

TEST_F(BusTest, SecondAnswerThatComesLaterPutsTheBusInDoubt) {
  read_with_another_answer_behind();
  script_doubted(kReadD100, word_frame(2));
  const Exchange second = read("D100");
  EXPECT_TRUE(second.is_data());
  EXPECT_TRUE(second.doubted) << "it may be right, and is not to be believed";
  EXPECT_TRUE(bus->doubt().is_doubted());
  EXPECT_EQ(bus->counters().unexpected_bytes, 8U);
  EXPECT_EQ(bus->last_unexpected(), word_frame(99));
}

TEST_F(BusTest, DoubtEndsWithThreeExchangesThatHadSilenceBeforeAndBehindThem) {
  read_with_another_answer_behind();
  for (unsigned i = 0; i < 3; ++i) script_doubted(kReadD100, word_frame(2));
  for (unsigned i = 0; i < 3; ++i) EXPECT_TRUE(read("D100").doubted) << i;
  // No read follows these answers.
  wire->expect(kReadD100).give(word_frame(3)).expect(kReadD100).give(word_frame(4)).hang();
  const Exchange believed = read("D100");
  EXPECT_TRUE(believed.is_data());
  EXPECT_FALSE(believed.doubted);
  EXPECT_EQ(believed.reply.image, word(4));
  EXPECT_EQ(wire->steps_left(), 1U);
  wire->skip();
}

TEST_F(BusTest, AfterADoubtALateSecondAnswerIsTakenForNoAnswer) {
  read_with_another_answer_behind();
  for (unsigned i = 0; i < 3; ++i) script_doubted(kReadD100, word_frame(2));
  for (unsigned i = 0; i < 3; ++i) EXPECT_TRUE(read("D100").doubted) << i;
  // The second answer to D100 arrives instead of the answer to D200, which then arrives as the
  // answer to the reread.
  wire->expect(kReadD200).give(word_frame(2)).expect(kReadD200).give(word_frame(7));
  EXPECT_EQ(read("D200").reply.image, word(7));
  wire->give(word_frame(8));
  script_doubted(kReadD200, word_frame(9));
  EXPECT_TRUE(read("D200").doubted) << "one answer more than questions has come";
}

TEST_F(BusWithoutEnquiry, AGoodFrameOfAnotherLengthMakesReadsTwice) {
  wire->expect(kReadD100).give(data_frame({1, 0, 2, 0})).silence();
  wire->expect(kReadD100).give(word_frame(2)).expect(kReadD100).give(word_frame(3));
  open();
  EXPECT_EQ(read("D100").outcome, Outcome::garbled);
  EXPECT_EQ(read("D100").reply.image, word(3)) << "the first answer may be another's too";
  EXPECT_FALSE(bus->doubt().is_doubted());
}

TEST_F(BusWithoutEnquiry, LinkLostBeforeTheSecondReadUsesTheLineTimeOfTheFirst) {
  wire->expect(kReadD100).give(data_frame({1, 0, 2, 0})).silence();
  wire->expect(kReadD100).give(word_frame(2)).hang_up();
  open();
  EXPECT_EQ(read("D100").outcome, Outcome::garbled);
  const Exchange lost = read("D100");
  EXPECT_EQ(lost.outcome, Outcome::link_down);
  EXPECT_GT(lost.line_time().count(), 0);
}

TEST_F(BusWithoutEnquiry, TwoAnswersWhileOneIsOwedMakeReadsTwice) {
  wire->expect(kReadD100).silence();
  wire->give(word_frame(1)).later(word_frame(1)).silence();
  wire->expect(kReadD100).give(word_frame(2)).expect(kReadD100).give(word_frame(3));
  open();
  EXPECT_EQ(read("D100").outcome, Outcome::unanswered);
  EXPECT_EQ(read("D100").reply.image, word(3));
  EXPECT_FALSE(bus->doubt().is_doubted());
}

TEST_F(BusWithoutEnquiry, TheOneAnswerThatIsOwedCostsNoSecondRead) {
  wire->expect(kReadD100).silence();
  wire->give(word_frame(1)).silence();
  wire->expect(kReadD100).give(word_frame(2));
  open();
  EXPECT_EQ(read("D100").outcome, Outcome::unanswered);
  EXPECT_EQ(read("D100").reply.image, word(2));
}

TEST_F(BusTest, WriteIsSentOnceHoweverWaryTheBusIs) {
  read_with_another_answer_behind();
  for (unsigned i = 0; i < 3; ++i) script_doubted(kReadD100, word_frame(2));
  for (unsigned i = 0; i < 3; ++i) read("D100");
  wire->expect(kWriteD200).give(kAck);
  EXPECT_TRUE(write_d200().is_ack());
}

TEST_F(BusTest, SecondAnswerDuringTheSilenceBehindTheFirstIsFoundAndLastsTheDoubt) {
  read_with_another_answer_behind();
  for (int i = 0; i < 9; ++i) {
    wire->silence();
    wire->expect(kProbe).give(kProbeAnswer);
    wire->expect(kReadD100).give(word_frame(2)).later(word_frame(2));
    const Exchange doubled = read("D100");
    EXPECT_FALSE(doubled.is_data()) << i;
    EXPECT_EQ(doubled.outcome, Outcome::garbled);
  }
  EXPECT_TRUE(bus->doubt().is_doubted());
}

TEST_F(BusTest, SilentDeviceDoesNotProlongTheDoubtOfItsLine) {
  read_with_another_answer_behind();
  script_doubted(kReadD100, word_frame(2));
  EXPECT_TRUE(read("D100").doubted);
  // A neighbour that is switched off answers neither the probe nor a request.
  wire->silence().expect(kProbe).silence();
  EXPECT_EQ(read("D200").outcome, Outcome::unanswered);
  wire->silence().expect(kNextProbe).give(kNextProbeAnswer).expect(kReadD200).silence();
  EXPECT_EQ(read("D200").outcome, Outcome::unanswered);
  EXPECT_TRUE(bus->doubt().is_doubted());
  for (int i = 0; i < 2; ++i) {
    wire->silence().expect(kNextProbe).give(kNextProbeAnswer);
    wire->expect(kReadD100).give(word_frame(2)).silence();
    EXPECT_TRUE(read("D100").doubted);
  }
  EXPECT_FALSE(bus->doubt().is_doubted()) << "three clean exchanges";
}

TEST_F(BusTest, DamagedAnswerProlongsTheDoubt) {
  read_with_another_answer_behind();
  script_doubted(kReadD100, word_frame(2));
  EXPECT_TRUE(read("D100").doubted);
  wire->silence().expect(kProbe).give(kProbeAnswer).expect(kReadD200).give({0x02, 0x30}).silence();
  EXPECT_EQ(read("D200").outcome, Outcome::unanswered);
  for (int i = 0; i < 2; ++i) {
    script_doubted(kReadD100, word_frame(2));
    EXPECT_TRUE(read("D100").doubted);
  }
  EXPECT_TRUE(bus->doubt().is_doubted());
}

TEST_F(BusTest, AnswerPastWhichAnOlderOneWasSkippedIsNoAnswer) {
  // Two answers to one request, of which only the second fits: the device is one answer behind.
  station.enquire = EnquirePolicy::never;
  wire->expect(kWriteD200).give(joined(word_frame(7), kAck));
  open();
  EXPECT_EQ(write_d200().outcome, Outcome::garbled);
  EXPECT_TRUE(bus->doubt().is_doubted());
}

TEST_F(BusWithoutEnquiry, NakThatLiesBehindAnAckTakesTheAckWithIt) {
  wire->expect(kWriteD200).give(joined(kAck, kNak));
  open();
  const Exchange first = write_d200();
  EXPECT_EQ(first.outcome, Outcome::garbled);
  expect_says(first.error, "15");
  EXPECT_EQ(bus->counters().bad_frames, 1U);
}

TEST_F(BusWithoutEnquiry, NakThatHasArrivedByTheTimeTheAckWasReadTakesItWithItToo) {
  wire->expect(kWriteD200).give(kAck).give(kNak);
  open();
  EXPECT_EQ(write_d200().outcome, Outcome::garbled);
}

TEST_F(BusWithoutEnquiry, AckIsNotBelievedOnceAnotherAnswerWasFoundBehindOne) {
  wire->expect(kWriteD200).give(kAck);
  open();
  EXPECT_TRUE(write_d200().is_ack()) << "nothing is known yet";
  wire->give(kNak);  // the PLC's own answer, after a stray ACK
  script_doubted(kWriteD200, kAck);
  const Exchange second = write_d200();
  EXPECT_EQ(second.outcome, Outcome::garbled);
  EXPECT_TRUE(second.sent);
  expect_says(second.error, "does not count");
}

TEST_F(BusTest, NakIsNotBelievedInDoubtEither) {
  // A NAK would promise that nothing was written.
  station.enquire = EnquirePolicy::never;
  wire->expect(kWriteD200).give(kAck);
  open();
  write_d200();
  wire->give(kAck);
  script_doubted(kWriteD200, kNak);
  EXPECT_EQ(write_d200().outcome, Outcome::garbled);
}

TEST_F(BusWithoutEnquiry, InDoubtItListensAsLongAsTheSlowestAnswerMayTake) {
  station.timeout = milliseconds(180);
  wire->expect(kReadD100).give(word_frame(1));
  open();
  read("D100");
  station.timeout = milliseconds(100);  // a faster neighbour on the same wire
  wire->give(word_frame(99)).hang();
  wire->expect(kProbe).give(kProbeAnswer).expect(kReadD100).give(word_frame(2)).hang();
  const auto before = Clock::now();
  const Exchange second = read("D100");
  EXPECT_GE(second.began - before, milliseconds(180));
  EXPECT_GE(Clock::now() - second.ended, milliseconds(180));
}

TEST_F(BusTest, AnswersWithNumbersAreNeverDoubted) {
  station.codec = codec = codec_of("modbus-tcp");
  const Read hr0{codec->addresses().parse_address("hr:0", {})->span};
  const Bytes first = *from_hex("00 01 00 00 00 05 01 03 02 00 64");
  wire->expect(*from_hex("00 01 00 00 00 06 01 03 00 00 00 01")).give(joined(first, first));
  wire->expect(*from_hex("00 02 00 00 00 06 01 03 00 00 00 01"));
  wire->give(joined(first, *from_hex("00 02 00 00 00 05 01 03 02 00 65")));
  open();
  EXPECT_EQ(ask(hr0).reply.image, word(100));
  const Exchange second = ask(hr0);
  EXPECT_EQ(second.reply.image, word(101));
  EXPECT_FALSE(second.doubted);
  EXPECT_EQ(bus->counters().unexpected_bytes, 22U) << "counted all the same";
}

TEST_F(BusTest, RtuAsksForLessFirstSoThatTheAnswersCanBeToldApart) {
  station.codec = codec = codec_of("modbus-rtu");
  const Read two{{codec->addresses().parse_address("hr:0", {})->span.space, 0, 32}};
  const Bytes question = *from_hex("01 03 00 00 00 02 C4 0B");
  const Bytes answer = *from_hex("01 03 04 00 64 00 65 7B C7");
  wire->expect(question).give(answer).give(answer);
  open();
  EXPECT_EQ(ask(two).outcome, Outcome::garbled) << "both are here: which one is it?";
  wire->silence();
  wire->expect(*from_hex("01 03 00 00 00 01 84 0A")).give(*from_hex("01 03 02 00 64 B9 AF"));
  wire->expect(question).give(answer).silence();
  EXPECT_TRUE(ask(two).doubted);
}

TEST_F(BusTest, EchoThatNobodyAwaitedIsNoForeignAnswer) {
  // On a two-wire line the command to unit 0 comes back as an echo and gets no answer.
  station.codec = codec = codec_of("modbus-rtu", {{"unit", std::int64_t{0}}});
  const Bytes admitted = *from_hex("00 06 00 01 00 AA 59 A4");
  const Write write{{codec->addresses().parse_address("hr:1", {})->span.space, 16, 16}, word(0xAA)};
  wire->expect(admitted).give(admitted).expect(admitted);
  open();
  EXPECT_TRUE(ask(write).is_ack());
  EXPECT_TRUE(ask(write).is_ack());
  EXPECT_FALSE(bus->doubt().is_doubted());
  EXPECT_EQ(bus->counters().unexpected_bytes, 0U);
}

// ---- a channel that is never silent ------------------------------------------------------------

TEST_F(BusTest, FloodBetweenTwoQuestionsClosesTheChannel) {
  wire->expect(kEnq).give(kAck).expect(kReadD100).give(word_frame(1));
  open();
  EXPECT_TRUE(read("D100").is_data());
  wire->give(Bytes(65536, 0x55));
  const Exchange flooded = read("D100");
  EXPECT_EQ(flooded.outcome, Outcome::link_down);
  EXPECT_FALSE(flooded.sent);
  expect_says(flooded.error, "without a pause");
  EXPECT_FALSE(bus->is_open());
  EXPECT_TRUE(bus->channel().never_silent());
}

TEST_F(BusTest, FloodWhileItListensClosesTheChannel) {
  wire->expect(kEnq).give(kAck).expect(kReadD100).silence();
  wire->later(Bytes(1 << 20, 0x55));
  open();
  EXPECT_EQ(read("D100").outcome, Outcome::unanswered);
  const Exchange flooded = read("D100");
  EXPECT_EQ(flooded.outcome, Outcome::link_down);
  EXPECT_EQ(flooded.line_time(), nanoseconds(0));
  EXPECT_FALSE(bus->is_open());
  EXPECT_TRUE(bus->channel().never_silent());
}

TEST_F(BusTest, ChannelThatFloodsFromTheStartDoesNotOpen) {
  wire->give(Bytes(65536, 0x55));
  const auto error = error_of(run_on(io, bus->open()));
  EXPECT_EQ(error.code, ErrorCode::link_down);
  expect_says(error.text, "without a pause");
  EXPECT_TRUE(bus->channel().never_silent());
  wire->refuse_open("the port is gone");
  EXPECT_FALSE(run_on(io, bus->open()));
  EXPECT_EQ(bus->last_unexpected(), Bytes(64, 0x55)) << "still what to show";
  expect_says(bus->unexpected_text(), "… (64 or more bytes)");
  wire->expect(kEnq).give(kAck).expect(kReadD100).give(word_frame(1));
  open();
  EXPECT_TRUE(bus->channel().never_silent()) << "until something was answered";
  EXPECT_TRUE(read("D100").is_data());
  EXPECT_FALSE(bus->channel().never_silent());
}

// ---- time --------------------------------------------------------------------------------------

TEST_F(BusTest, AnswerHasTheTimeOfItsCharactersBesideTheTimeout) {
  // 11 characters out and 8 back: a slow line does not make a slow device.
  make_bus(milliseconds(4));
  station.enquire = EnquirePolicy::never;
  station.timeout = milliseconds(5);
  wire->expect(kReadD100).hang();
  open();
  const Exchange exchange = read("D100");
  EXPECT_EQ(exchange.outcome, Outcome::unanswered);
  EXPECT_GE(exchange.ended - exchange.began, 19 * milliseconds(4) + station.timeout);
}

TEST_F(BusTest, CommandWhoseTimeHasPassedIsNotSent) {
  wire->expect(kEnq).give(kAck).expect(kReadD100).give(word_frame(1));
  open();
  read("D100");
  const Exchange late = ask(request_for("D200"), Clock::now() - milliseconds(1));
  EXPECT_EQ(late.outcome, Outcome::expired);
  EXPECT_FALSE(late.sent);
}

TEST_F(BusTest, TimeIsCheckedAfterEverythingThatPrecedesTheFirstByte) {
  // The enquiry takes time: a command may expire during it.
  SteadyTime not_after = Clock::now() + milliseconds(20);
  wire->expect(kEnq);
  wire->call([&] {
    while (Clock::now() <= not_after) {
    }
  });
  wire->give(kAck);
  open();
  not_after = Clock::now() + milliseconds(20);
  const Exchange late = ask(request_for("D100"), not_after);
  EXPECT_EQ(late.outcome, Outcome::expired);
  EXPECT_FALSE(late.sent);
}

TEST_F(BusTest, GapIsKeptBetweenTwoRequests) {
  station.gap = milliseconds(15);
  wire->expect(kEnq).give(kAck).expect(kReadD100).give(word_frame(1));
  wire->expect(kReadD100).give(word_frame(2));
  open();
  const Exchange first = read("D100");
  const Exchange second = read("D100");
  EXPECT_GE(second.began - first.ended, milliseconds(15));
  EXPECT_EQ(second.rest, milliseconds(15));
  EXPECT_EQ(second.line_time(), milliseconds(15) + (second.ended - second.began));
  EXPECT_GE(bus->counters().busy, milliseconds(15)) << "nobody else can use the line meanwhile";
}

TEST_F(BusTest, EnquiryIsLineTimeOfTheRequestThatFollowsIt) {
  station.gap = milliseconds(2);
  station.enquire = EnquirePolicy::always;
  for (unsigned i = 0; i < 2; ++i)
    wire->expect(kEnq).give(kAck).expect(kReadD100).give(word_frame(i));
  open();
  for (int i = 0; i < 2; ++i) EXPECT_GT(read("D100").rest, 2 * station.gap);
}

TEST_F(BusTest, ReadWaitsForItsDeadlineAndNoLonger) {
  station.timeout = milliseconds(5);
  wire->expect(kEnq).give(kAck).expect(kReadD100).hang();
  open();
  const Exchange exchange = read("D100");
  EXPECT_EQ(exchange.outcome, Outcome::unanswered);
  EXPECT_GE(exchange.ended - exchange.began, milliseconds(5));
}

// ---- broken connections ------------------------------------------------------------------------

TEST_F(BusTest, LinkLostBeforeTheFirstByteSendsNothing) {
  wire->expect(kEnq).give(kAck).expect(kReadD100).give(word_frame(1)).hang_up();
  open();
  read("D100");
  const Exchange exchange = write_d200();
  EXPECT_EQ(exchange.outcome, Outcome::link_down);
  EXPECT_FALSE(exchange.sent);
  EXPECT_FALSE(bus->is_open());
  EXPECT_FALSE(exchange.error.empty());
}

TEST_F(BusTest, WriteThatBreaksBeforeItsFirstByteWasNotSent) {
  wire->expect(kEnq).give(kAck).break_write(0);
  open();
  const Exchange exchange = write_d200();
  EXPECT_EQ(exchange.outcome, Outcome::link_down);
  EXPECT_FALSE(exchange.sent);
  EXPECT_FALSE(bus->is_open());
}

TEST_F(BusTest, WriteThatBreaksAfterOneByteWasSent) {
  wire->expect(kEnq).give(kAck).break_write(1);
  open();
  const Exchange exchange = write_d200();
  EXPECT_EQ(exchange.outcome, Outcome::link_down);
  EXPECT_TRUE(exchange.sent);
}

TEST_F(BusTest, LinkLostWhileWaitingWasSent) {
  wire->expect(kEnq).give(kAck).expect(kWriteD200).hang_up();
  open();
  const Exchange exchange = write_d200();
  EXPECT_EQ(exchange.outcome, Outcome::link_down);
  EXPECT_TRUE(exchange.sent);
  EXPECT_FALSE(bus->is_open());
}

TEST_F(BusTest, LinkLostDuringTheEnquirySendsNothingElse) {
  wire->expect(kEnq).hang_up();
  open();
  const Exchange exchange = write_d200();
  EXPECT_EQ(exchange.outcome, Outcome::link_down);
  EXPECT_FALSE(exchange.sent);
}

TEST_F(BusTest, LinkLostDuringTheDrainSendsNothing) {
  wire->expect(kEnq).give(kAck).expect(kReadD100).silence().later({0x55}).hang_up();
  open();
  EXPECT_EQ(read("D100").outcome, Outcome::unanswered);
  const Exchange exchange = write_d200();
  EXPECT_EQ(exchange.outcome, Outcome::link_down);
  EXPECT_FALSE(exchange.sent);
  EXPECT_EQ(exchange.line_time(), nanoseconds(0)) << "nothing was sent";
}

TEST_F(BusTest, ClosingEndsAWaitingExchange) {
  station.timeout = std::chrono::hours(1);
  wire->expect(kEnq).give(kAck).expect(kReadD100).call(
      [&] { asio::post(io, [&] { bus->close(); }); });
  wire->hang();
  open();
  EXPECT_EQ(read("D100").outcome, Outcome::link_down);
}

TEST_F(BusTest, ChannelThatWillNotOpenSaysWhy) {
  wire->refuse_open("no such adapter");
  const auto error = error_of(run_on(io, bus->open()));
  EXPECT_EQ(error.code, ErrorCode::link_down);
  EXPECT_EQ(error.text, "no such adapter");
  EXPECT_FALSE(bus->is_open());
}

TEST_F(BusTest, PeerThatGoesRightAfterOpeningIsAFailureToOpen) {
  wire->hang_up();
  const auto opened = run_on(io, bus->open());
  EXPECT_FALSE(opened);
  EXPECT_FALSE(bus->is_open());
}

// ---- counters ----------------------------------------------------------------------------------

TEST_F(BusTest, EachEndOfAnExchangeIsCounted) {
  Bytes wrong = word_frame(7);
  wrong.back() = wrong.back() == '0' ? '1' : '0';
  station.enquire = EnquirePolicy::never;
  wire->expect(kReadD100).give(word_frame(1));
  wire->expect(kWriteD200).give(kNak);
  wire->expect(kReadD100).give(wrong);
  wire->expect(kReadD100).silence();
  open();
  read("D100");
  write_d200();
  read("D100");
  read("D100");
  ask(request_for("D100"), Clock::now() - milliseconds(1));
  const Wire::Counters& counters = bus->counters();
  EXPECT_EQ(counters.exchanges, 4U) << "the one that expired was never sent";
  EXPECT_EQ(counters.naks, 1U);
  EXPECT_EQ(counters.bad_frames, 1U);
  EXPECT_EQ(counters.timeouts, 1U);
  EXPECT_GT(counters.busy.count(), 0);
  EXPECT_GE(counters.turnaround_ms.percentiles().p99, counters.turnaround_ms.percentiles().p50);
}

}  // namespace
}  // namespace fxagent::test
