// MC stations over real sockets: connections, datagrams and faults of the wire.

#include "tests/sim/sample_plc.h"
#include "tests/sim/simulator_client.h"

namespace fxsim {
namespace {

// Reads of D0, D1 and D2, and their values.
const Bytes kRead3E = hex("50 00 00 FF FF 03 00 0C 00 10 00 01 04 00 00 00 00 00 A8 01 00");
constexpr std::string_view kData3E = "D0 00 00 FF FF 03 00 04 00 00 00 34 12";

Bytes read_4e(std::uint8_t serial) {
  auto request = hex("54 00 00 00 00 00 00 FF FF 03 00 0C 00 10 00 01 04 00 00 00 00 00 A8 01 00");
  request[2] = serial;
  return request;
}
std::string data_4e(std::uint8_t serial) {
  auto answer = hex("D4 00 00 00 00 00 00 FF FF 03 00 04 00 00 00 34 12");
  answer[2] = serial;
  return to_hex(answer);
}

json station(json extra = json::object()) {
  auto plc = network({{"protocol", "mc-3e"}, {"memory", {{"D0", 0x1234}}}});
  if (extra.contains("udp")) plc.erase("tcp");
  plc.update(extra);
  return plc;
}

json fault(json keys) {
  json request = {{"cmd", "fault"}, {"plc", "p1"}};
  request.update(keys);
  return request;
}

json stats(const Running& sim) { return sim.control({{"cmd", "stats"}, {"plc", "p1"}}); }

TEST(McOnTcp, AnswersAndCountsWhatItIsAsked) {
  const Running sim(station());
  const auto client = sim.tcp();
  EXPECT_EQ(to_hex(client.ask(kRead3E, 13)), kData3E);
  client.send(ByteView(kRead3E).first(5));
  client.send(ByteView(kRead3E).subspan(5));
  EXPECT_EQ(to_hex(client.receive(13)), kData3E);
  EXPECT_EQ(
      client.ask(hex("50 00 00 FF FF 03 00 0C 00 10 00 01 04 00 00 00 00 00 A8 07 00"), 25).size(),
      25U);
  const auto told = stats(sim);
  EXPECT_EQ(told["commands"], json::parse(R"({"0401/0000": 3})"));
  EXPECT_EQ(told["most_read"], 7);
  EXPECT_EQ(told["most_written"], 0);
  EXPECT_EQ(told["overlaps"], 0);
}

TEST(McOnTcp, QuestionsBeforeTheAnswerAreCounted) {
  const Running sim(station({{"turnaround_ms", 20}}));
  const auto client = sim.tcp();
  auto both = read_4e(1);
  const auto second = read_4e(2);
  both.insert(both.end(), second.begin(), second.end());
  EXPECT_EQ(to_hex(client.ask(both, 34)), data_4e(1) + " " + data_4e(2));
  EXPECT_EQ(stats(sim)["overlaps"], 1);
}

TEST(McOnTcp, ASecondConnectionIsAcceptedAndClosedAtOnce) {
  const Running sim(station({{"connections", 1}}));
  {
    const auto first = sim.tcp();
    EXPECT_EQ(to_hex(first.ask(kRead3E, 13)), kData3E);
    const auto second = sim.tcp();
    EXPECT_TRUE(second.ended());
    EXPECT_EQ(to_hex(first.ask(kRead3E, 13)), kData3E);
  }
  const auto third = sim.tcp();
  EXPECT_EQ(to_hex(third.ask(kRead3E, 13)), kData3E);
  EXPECT_EQ(stats(sim)["turned_away"], 1);
}

TEST(McOnTcp, AnAnswerCanComeTwiceOrWithTheNextOne) {
  const Running sim(station());
  const auto client = sim.tcp();
  sim.control(fault({{"kind", "twice"}}));
  EXPECT_EQ(to_hex(client.ask(read_4e(1), 34)), data_4e(1) + " " + data_4e(1));
  sim.control(fault({{"kind", "coalesced"}}));
  client.send(read_4e(2));
  EXPECT_EQ(to_hex(client.ask(read_4e(3), 34)), data_4e(2) + " " + data_4e(3));
}

TEST(McOnTcp, AnAnswerCanBeOvertaken) {
  const Running sim(station());
  const auto client = sim.tcp();
  sim.control(fault({{"kind", "overtaken"}, {"ms", 150}}));
  client.send(read_4e(1));
  EXPECT_EQ(to_hex(client.ask(read_4e(2), 17)), data_4e(2));
  EXPECT_EQ(to_hex(client.receive(17)), data_4e(1));
  EXPECT_EQ(stats(sim)["overlaps"], 1);
}

TEST(McOnTcp, StationsOfOnePortAnswerToTheirRoutes) {
  const Running sim(station({{"model", "iQ-R"}}), {{"name", "p2"},
                                                   {"with", "p1"},
                                                   {"model", "iQ-R"},
                                                   {"network", 1},
                                                   {"pc", 2},
                                                   {"turnaround_ms", 0},
                                                   {"memory", {{"D0", 7}}}});
  const auto client = sim.tcp();
  EXPECT_EQ(to_hex(client.ask(kRead3E, 13)), kData3E);
  auto request = kRead3E;
  request[2] = 1;
  request[3] = 2;
  EXPECT_EQ(to_hex(client.ask(request, 13)), "D0 00 01 02 FF 03 00 04 00 00 00 07 00");
  request[3] = 9;
  EXPECT_EQ(to_hex(client.ask(request, 20)),
            "D0 00 01 09 FF 03 00 0B 00 00 4A 01 09 FF 03 00 01 04 00 00");
}

TEST(McOnUdp, OneDatagramIsOneFrame) {
  const Running sim(station({{"udp", 0}}));
  const auto client = Client::udp(sim.port("p1"));
  const auto other = Client::udp(sim.port("p1"));
  client.send_datagram(ByteView(kRead3E).first(10));
  client.send_datagram(ByteView(kRead3E).subspan(10));
  auto longer = kRead3E;
  longer.push_back(0);
  client.send_datagram(longer);
  client.send_datagram(kRead3E);
  const auto got = client.datagram();
  EXPECT_EQ(to_hex(got.bytes), kData3E);
  EXPECT_EQ(got.from, sim.port("p1"));
  other.send_datagram(kRead3E);
  EXPECT_EQ(to_hex(other.datagram().bytes), kData3E);
  const auto told = stats(sim);
  EXPECT_EQ(told["requests"]["read"], 2);
  EXPECT_EQ(told["requests"]["malformed"], 3);
}

TEST(McOnUdp, APeerPortThatIsSetIsTheOnlyOneHeard) {
  const auto right = Client::udp(0);
  const Running sim(station({{"udp", 0}, {"udp_peer_port", right.own_port()}}));
  const auto wrong = Client::udp(sim.port("p1"));
  wrong.send_datagram(kRead3E);
  const auto peer = Client::udp_of(right, sim.port("p1"));
  peer.send_datagram(kRead3E);
  EXPECT_EQ(to_hex(peer.datagram().bytes), kData3E);
  EXPECT_EQ(wrong.datagram(milliseconds(0)).bytes.size(), 0U);
  EXPECT_EQ(stats(sim)["strangers"], 1);
}

TEST(McOnUdp, AnswersAreLostDoubledOvertakenAndComeFromElsewhere) {
  const Running sim(station({{"udp", 0}}));
  const auto client = Client::udp(sim.port("p1"));
  const auto next = [&client] { return to_hex(client.datagram().bytes); };
  sim.control(fault({{"kind", "execute_then_silent"}}));
  client.send_datagram(read_4e(1));
  sim.control(fault({{"kind", "twice"}}));
  client.send_datagram(read_4e(2));
  EXPECT_EQ(next(), data_4e(2));
  EXPECT_EQ(next(), data_4e(2));
  sim.control(fault({{"kind", "overtaken"}}));
  client.send_datagram(read_4e(3));
  client.send_datagram(read_4e(4));
  EXPECT_EQ(next(), data_4e(4));
  EXPECT_EQ(next(), data_4e(3));
  sim.control(fault({{"kind", "from_elsewhere"}}));
  client.send_datagram(read_4e(5));
  const auto got = client.datagram();
  EXPECT_EQ(to_hex(got.bytes), data_4e(5));
  EXPECT_NE(got.from, sim.port("p1"));
  sim.control(fault({{"kind", "split"}, {"bytes", 9}, {"ms", 0}}));
  client.send_datagram(read_4e(6));
  EXPECT_EQ(client.datagram().bytes.size(), 9U);
  EXPECT_EQ(client.datagram().bytes.size(), 8U);
}

TEST(McOnUdp, ADoubledRequestIsCarriedOutTwice) {
  const Running sim(station({{"udp", 0}}));
  const auto client = Client::udp(sim.port("p1"));
  sim.control(fault({{"kind", "asked_twice"}}));
  client.send_datagram(hex("50 00 00 FF FF 03 00 0E 00 10 00 01 14 00 00 00 00 00 A8 01 00 05 00"));
  constexpr std::string_view kDone = "D0 00 00 FF FF 03 00 02 00 00 00";
  EXPECT_EQ(to_hex(client.datagram().bytes), kDone);
  EXPECT_EQ(to_hex(client.datagram().bytes), kDone);
  EXPECT_EQ(stats(sim)["accepted_writes"], 2);
}

TEST(McOnUdp, ADroppedPortComesBack) {
  const Running sim(station({{"udp", 0}}));
  const auto client = Client::udp(sim.port("p1"));
  sim.control(fault({{"kind", "drop"}, {"ms", 50}}));
  client.send_datagram(kRead3E);
  Bytes got;
  for (int i = 0; i < 100 && got.empty(); ++i) {
    client.send_datagram(kRead3E);
    got = client.datagram(milliseconds(50)).bytes;
  }
  EXPECT_EQ(to_hex(got), kData3E);
}

TEST(McOnUdp, OneEAnswersToo) {
  const Running sim(station({{"udp", 0}, {"protocol", "mc-1e"}, {"model", "FX3U"}}));
  const auto client = Client::udp(sim.port("p1"));
  client.send_datagram(hex("01 FF 0A 00 00 00 00 00 20 44 01 00"));
  EXPECT_EQ(to_hex(client.datagram().bytes), "81 00 34 12");
}

TEST(McOnALine, StationsOfOneWireAnswerInTheirTurn) {
  const Running sim(
      serial({{"protocol", "mc-4c"}, {"format", 5}, {"memory", {{"M100", {0, 0, 1}}}}}),
      {{"name", "p2"}, {"with", "p1"}, {"station", 3}, {"turnaround_ms", 0}});
  const auto client = sim.terminal();
  EXPECT_EQ(
      to_hex(client.ask(
          hex("10 02 12 00 F8 00 00 FF FF 03 00 00 01 04 00 00 64 00 00 90 02 00 10 03 30 36"),
          25)),
      "10 02 10 10 00 F8 00 00 FF FF 03 00 00 FF FF 00 00 04 00 00 00 10 03 30 42");
  EXPECT_EQ(
      to_hex(client.ask(
          hex("10 02 12 00 F8 03 00 FF FF 03 00 00 01 04 00 00 64 00 00 90 02 00 10 03 30 39"),
          25)),
      "10 02 10 10 00 F8 03 00 FF FF 03 00 00 FF FF 00 00 00 00 00 00 10 03 30 41");
}

}  // namespace
}  // namespace fxsim
