// The bus on UDP: a datagram is exactly one frame or invalid.
#include <gtest/gtest.h>

#include <asio/ip/udp.hpp>

#include "agent/field/bus/bus.h"
#include "agent/field/transport/transport.h"
#include "protocol/catalog.h"
#include "tests/agent/field/field_plant.h"
#include "tests/agent/field/port_frames.h"
#include "tests/agent/field/scripted_bus.h"

namespace fxagent::test {
namespace {

using std::chrono::milliseconds;
using Outcome = Exchange::Outcome;
using Port = ScriptedTransport::Port;

struct DatagramBus : ScriptedBusTest {
  void use(std::string_view protocol, Port port) {
    make_bus({}, {}, port);
    station.codec = codec_of(protocol);
    station.enquire = EnquirePolicy::never;
  }
  std::uint64_t unexpected() { return bus->counters().unexpected_bytes; }
};

/// A protocol with numbered answers; every request reads hr:0 under its own number.
struct NumberedDatagrams : DatagramBus {
  NumberedDatagrams() { use("modbus-tcp", Port::renewed); }
  static Bytes question(unsigned number) {
    return *from_hex("00 0" + std::to_string(number) + " 00 00 00 06 01 03 00 00 00 01");
  }
  static Bytes answer(unsigned number, unsigned value) {
    return *from_hex("00 0" + std::to_string(number) + " 00 00 00 05 01 03 02 00 0" +
                     std::to_string(value));
  }
};

TEST_F(NumberedDatagrams, HalfAFrameIsNotCompletedByTheNextDatagram) {
  const Bytes whole = answer(1, 7);
  const Bytes half(whole.begin(), whole.begin() + 6);
  const Bytes rest(whole.begin() + 6, whole.end());
  wire->expect(question(1)).give(half).give(rest).silence();
  open();
  const Exchange exchange = read("hr:0");
  EXPECT_NE(exchange.outcome, Outcome::answered);
  EXPECT_EQ(unexpected(), half.size());
  EXPECT_TRUE(bus->is_open());
}

TEST_F(NumberedDatagrams, HalfAFrameDoesNotKeepTheWholeOneFromBeingTaken) {
  const Bytes whole = answer(1, 7);
  wire->expect(question(1)).give({whole.begin(), whole.begin() + 6}).give(whole);
  open();
  EXPECT_EQ(read("hr:0").reply.image, word(7));
}

TEST_F(NumberedDatagrams, LateAndDoubledAnswersAreDroppedAndCounted) {
  wire->expect(question(1)).silence();
  wire->expect(question(2)).give(answer(1, 7)).give(answer(1, 7)).give(answer(2, 8));
  wire->expect(question(3)).give(answer(2, 8)).give(answer(3, 9));
  open();
  EXPECT_EQ(read("hr:0").outcome, Outcome::unanswered);
  EXPECT_EQ(read("hr:0").reply.image, word(8));
  const Exchange third = read("hr:0");
  EXPECT_EQ(third.reply.image, word(9));
  EXPECT_FALSE(third.doubted);
  EXPECT_EQ(unexpected(), 3 * answer(1, 7).size());
  EXPECT_EQ(wire->renewed(), 0U) << "its answers are told apart by their numbers";
}

TEST_F(NumberedDatagrams, WhatComesInPlaceOfTheAnswerIsShown) {
  wire->expect(question(2 - 1)).give(answer(9, 1)).silence();
  open();
  const Exchange exchange = read("hr:0");
  EXPECT_EQ(exchange.outcome, Outcome::unanswered);
  EXPECT_EQ(exchange.received, answer(9, 1));
  EXPECT_NE(exchange.error.find(to_hex(answer(9, 1))), std::string::npos) << exchange.error;
}

TEST_F(NumberedDatagrams, FloodOfDatagramsEndsTheExchange) {
  wire->expect(question(1));
  for (int i = 0; i < 2000; ++i) wire->later(answer(9, 1));
  open();
  const Exchange exchange = read("hr:0");
  EXPECT_EQ(exchange.outcome, Outcome::link_down);
  EXPECT_TRUE(exchange.sent);
  EXPECT_TRUE(bus->channel().never_silent());
  EXPECT_FALSE(bus->is_open());
  EXPECT_GT(wire->steps_left(), 0U);
  while (wire->steps_left() > 0) wire->skip();
}

TEST_F(NumberedDatagrams, TwoAnswersInOneDatagramAreNone) {
  wire->expect(question(1)).give(joined(answer(1, 7), answer(1, 8)));
  wire->expect(question(2)).give(joined(answer(1, 7), answer(2, 8)));
  open();
  EXPECT_EQ(read("hr:0").outcome, Outcome::garbled);
  EXPECT_EQ(read("hr:0").outcome, Outcome::garbled);
}

TEST_F(DatagramBus, FixedPortDoesNotBeginWithTheNumbersOfADeadAgent) {
  std::set<Bytes> first;
  for (int agent = 0; agent < 8; ++agent) {
    use("modbus-tcp", Port::fixed);
    wire->then([](ByteView) { return Bytes(); });
    open();
    read("hr:0");
    const Bytes& asked = wire->written().at(0);
    first.insert({asked.begin(), asked.begin() + 2});
  }
  EXPECT_GT(first.size(), 4U);
}

TEST_F(NumberedDatagrams, NonsenseLeavesThePortOpenAndTheNextQuestionGoesAtOnce) {
  const Bytes nonsense = *from_hex("00 01 00 07 FF FF 01 03 02 00 07");
  wire->expect(question(1)).give(nonsense);
  wire->expect(question(2)).give(answer(2, 8));
  open();
  EXPECT_EQ(read("hr:0").outcome, Outcome::garbled);
  EXPECT_TRUE(bus->is_open());
  EXPECT_EQ(read("hr:0").reply.image, word(8));
}

/// A protocol whose answers have no numbers.
struct DatagramsWithoutNumbers : DatagramBus {
  const Bytes kRead = read_frame(kD100, 2);
};

TEST_F(DatagramsWithoutNumbers, EachQuestionIsAskedFromAPortOfItsOwn) {
  use("fx-programming-port", Port::renewed);
  wire->expect(kRead).give(word_frame(1)).give(word_frame(1));  // the second goes to the old port
  wire->expect(kRead).give(word_frame(2));
  open();
  EXPECT_EQ(read("D100").reply.image, word(1));
  const Exchange second = read("D100");
  EXPECT_EQ(second.reply.image, word(2));
  EXPECT_EQ(wire->renewed(), 2U);
  EXPECT_FALSE(second.doubted) << "on the new port it could not come";
  EXPECT_FALSE(bus->doubt().is_doubted());
  EXPECT_EQ(unexpected(), word_frame(1).size()) << "it is counted";
}

TEST_F(DatagramsWithoutNumbers, AfterASilenceTheLateAnswerHasItsTime) {
  use("fx-programming-port", Port::renewed);
  station.timeout = milliseconds(150);
  wire->expect(kRead).silence();
  wire->later(word_frame(1)).hang();
  wire->expect(kRead).give(word_frame(2));
  open();
  const Exchange silent = read("D100");
  EXPECT_EQ(silent.outcome, Outcome::unanswered);
  const Exchange second = read("D100");
  EXPECT_EQ(second.reply.image, word(2));
  EXPECT_GE(second.began - silent.ended, milliseconds(100));
}

TEST_F(DatagramsWithoutNumbers, AfterARefusalNoAnswerIsAwaited) {
  asio::ip::udp::socket unused(io, {asio::ip::address_v4::loopback(), 0});
  const std::uint16_t port = unused.local_endpoint().port();
  unused.close();
  bus = std::make_unique<Bus>(io.get_executor(),
                              make_udp_transport(io.get_executor(), {"127.0.0.1", port}),
                              std::chrono::nanoseconds(0), std::chrono::nanoseconds(0));
  station.codec = codec_of("fx-programming-port");
  station.enquire = EnquirePolicy::never;
  station.timeout = milliseconds(2000);
  open();
  const Exchange first = read("D100");
  EXPECT_EQ(first.outcome, Outcome::link_down);
  EXPECT_EQ(bus->channel().why_lost(), first.error);
  open();
  const Exchange second = read("D100");
  EXPECT_EQ(second.error, first.error);
  EXPECT_LT(second.began - first.ended, station.timeout);
}

TEST_F(DatagramsWithoutNumbers, FixedPortIsDoubtedLikeASerialLine) {
  use("fx-programming-port", Port::fixed);
  wire->silence();  // during open()
  wire->expect(kRead).give(word_frame(1));
  wire->give(word_frame(1));
  wire->silence().expect(read_frame(kM8000, 1)).give(data_frame({0x01}));
  wire->expect(kRead).give(word_frame(2)).silence();
  open();
  EXPECT_EQ(read("D100").outcome, Outcome::garbled) << "two answers came";
  EXPECT_TRUE(bus->doubt().is_doubted());
  EXPECT_TRUE(read("D100").doubted);
  EXPECT_EQ(wire->renewed(), 0U);
}

TEST_F(DatagramsWithoutNumbers, TheLateAckOfA1EWriteIsNotThatOfTheNext) {
  const auto write = [](const std::string& value) {  // to D200
    return *from_hex("03 FF 10 00 C8 00 00 00 20 44 01 00 " + value);
  };
  const auto bits = [](const std::string& points) {  // M0 up
    return *from_hex("00 FF 10 00 00 00 00 00 20 4D " + points + " 00");
  };
  use("mc-1e", Port::fixed);
  station.timeout = milliseconds(100);
  const auto ask = [&](std::uint8_t value) {
    const Span d200 = station.codec->addresses().parse_address("D200", {})->span;
    return run_on(io, bus->exchange(station, Write{d200, {value, 0}}));
  };
  wire->silence();  // during open()
  wire->expect(write("05 00")).silence();
  wire->silence().expect(bits("01")).give(*from_hex("83 00"));  // too late for the drain
  wire->silence().expect(bits("03")).give(*from_hex("80 00 10 00"));
  wire->expect(write("07 00")).give(*from_hex("83 00"));
  open();
  EXPECT_EQ(ask(5).outcome, Outcome::unanswered);
  const Exchange second = ask(6);
  EXPECT_FALSE(second.has_answer()) << "that was the answer to the first one";
  EXPECT_FALSE(second.sent);
  EXPECT_TRUE(ask(7).is_ack());
}

TEST_F(DatagramsWithoutNumbers, WhetherAnythingWasAnsweredBeforeTheEndIsKnown) {
  use("fx-programming-port", Port::renewed);
  wire->expect(kRead).hang_up();
  open();
  EXPECT_EQ(read("D100").outcome, Outcome::link_down);
  EXPECT_TRUE(bus->channel().closed_unanswered());
  EXPECT_FALSE(bus->channel().was_ever_answered());
  wire->expect(kRead).give(word_frame(1)).hang_up();
  open();
  EXPECT_TRUE(read("D100").is_data());
  EXPECT_EQ(read("D100").outcome, Outcome::link_down);
  EXPECT_FALSE(bus->channel().closed_unanswered());
  EXPECT_TRUE(bus->channel().was_ever_answered());
}

}  // namespace
}  // namespace fxagent::test
