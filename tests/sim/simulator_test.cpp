// The simulator over real pseudo terminals and sockets. Times have only a lower bound: a busy
// machine may be late, but a paced line is never early.

#include "tests/sim/simulator.h"

#include <sys/ioctl.h>

#include <fstream>

#include "tests/sim/simulator_client.h"

namespace fxsim {
namespace {

using std::chrono::microseconds;

constexpr microseconds kCharacterAt9600{1041};

const Bytes kEnq{0x05};
const Bytes kRead64 = *from_hex("02 30 31 30 30 30 34 30 03 35 38");  // D0 to D31
const Bytes kForceM100 = *from_hex("02 37 36 34 30 38 03 30 43");

TEST(Simulator, AnswersOnATerminalAndOnTcp) {
  Running sim(serial(), network({{"name", "p2"}, {"memory", {{"D0", 0x1234}}}}));
  EXPECT_EQ(sim.terminal().ask(kEnq, 1), Bytes{0x06});
  const auto reply = Client::tcp(sim.port("p2")).ask(kRead64, 132);
  ASSERT_EQ(reply.size(), 132U);
  EXPECT_EQ(to_hex(ByteView(reply).first(5)), "02 33 34 31 32");
}

TEST(Simulator, LineTimeIsKeptInBothDirections) {
  for (const bool on_terminal : {true, false}) {
    SCOPED_TRACE(on_terminal ? "pty" : "tcp");
    const json pace = {{"baud", 9600}, {"turnaround_ms", 20}};
    Running sim(on_terminal ? serial(pace) : network(pace));
    const auto client = on_terminal ? sim.terminal() : sim.tcp();
    const auto sent = Clock::now();
    client.send(kRead64);
    const auto head = client.receive(1);
    const auto first = Clock::now() - sent;
    const auto rest = client.receive(131);
    const auto last = Clock::now() - sent;
    ASSERT_EQ(head.size() + rest.size(), 132U);
    const auto request_time = kCharacterAt9600 * kRead64.size() + milliseconds(20);
    EXPECT_GE(first, request_time + kCharacterAt9600);
    EXPECT_GE(last, request_time + kCharacterAt9600 * 132);
  }
}

TEST(Simulator, CharacterOfElevenBitsTakesLonger) {
  Running sim(serial({{"baud", 2400}, {"data_bits", 8}}));  // 8E1: 4.58 ms a character
  const auto sent = Clock::now();
  EXPECT_EQ(sim.terminal().ask(kForceM100, 1).size(), 1U);
  EXPECT_GE(Clock::now() - sent, microseconds(4583) * 10);
}

TEST(Simulator, SecondRequestWaitsForTheWire) {
  Running sim(serial({{"baud", 9600}}));
  const auto client = sim.terminal();
  const auto sent = Clock::now();
  client.send(kForceM100);
  client.send(kForceM100);
  EXPECT_EQ(client.receive(2).size(), 2U);
  EXPECT_GE(Clock::now() - sent, kCharacterAt9600 * (2 * kForceM100.size() + 1));
}

TEST(Simulator, SeveralClientsShareOneTcpPlc) {
  Running sim(network());
  const auto one = sim.tcp();
  const auto two = sim.tcp();
  one.send(ByteView(kForceM100).first(4));  // half a request on one line does not disturb the other
  EXPECT_EQ(two.ask(kForceM100, 1), Bytes{0x06});
  EXPECT_EQ(one.ask(ByteView(kForceM100).subspan(4), 1), Bytes{0x06});
}

TEST(Simulator, TerminalOutlivesItsClients) {
  Running sim(serial());
  for (int i = 0; i < 5; ++i) {
    auto client = sim.terminal();
    ::ioctl(client.fd(), TIOCEXCL);
    EXPECT_EQ(client.ask(kEnq, 1), Bytes{0x06});
    client.close();
  }
  auto client = sim.terminal();
  client.send(kRead64);  // closes with an answer on its way, which the next client must not receive
  EXPECT_EQ(client.receive(1).size(), 1U);
  client.close();
  // The simulator handles the close as an event; once it has answered here it has handled it.
  sim.control({{"cmd", "stats"}, {"plc", "p1"}});
  EXPECT_EQ(sim.terminal().ask(kEnq, 1), Bytes{0x06});
}

TEST(Simulator, LateAnswerComesLate) {
  Running sim(serial({{"faults", json::array({{{"kind", "late"}, {"ms", 150}}})}}));
  const auto client = sim.terminal();
  const auto sent = Clock::now();
  EXPECT_EQ(client.ask(kEnq, 1), Bytes{0x06});
  EXPECT_GE(Clock::now() - sent, milliseconds(150));
}

TEST(Simulator, SplitAnswerPausesBetweenPieces) {
  Running sim(network({{"faults", json::array({{{"kind", "split"}, {"bytes", 50}, {"ms", 60}}})}}));
  const auto client = sim.tcp();
  const auto sent = Clock::now();
  EXPECT_EQ(client.ask(kRead64, 132).size(), 132U);  // 50, 50 and 32
  EXPECT_GE(Clock::now() - sent, milliseconds(120));
}

TEST(Simulator, EchoIsOnTheWireBeforeTheReply) {
  Running sim(serial({{"baud", 9600}, {"faults", json::array({{{"kind", "echo"}}})}}));
  auto expected = kForceM100;
  expected.push_back(0x06);
  EXPECT_EQ(sim.terminal().ask(kForceM100, expected.size()), expected);
}

TEST(Simulator, DroppedTerminalComesBackUnderItsName) {
  Running sim(serial({{"faults", json::array({{{"kind", "drop"}, {"ms", 0}}})}}));
  const auto client = sim.terminal();
  client.send(kEnq);
  EXPECT_TRUE(client.ended());
  const auto end = Clock::now() + kPatience;
  Bytes reply;
  while (reply.empty() && Clock::now() < end) {
    if (!std::filesystem::exists(sim.path("p1"))) continue;
    const auto again = sim.terminal();
    if (::write(again.fd(), kEnq.data(), 1) == 1) reply = again.receive(1, milliseconds(200));
  }
  EXPECT_EQ(reply, Bytes{0x06});
}

TEST(Simulator, DroppedConnectionCanBeMadeAgain) {
  Running sim(network({{"faults", json::array({{{"kind", "drop"}, {"ms", 0}}})}}));
  const auto client = sim.tcp();
  client.send(kEnq);
  EXPECT_TRUE(client.ended());
  EXPECT_EQ(sim.tcp().ask(kEnq, 1), Bytes{0x06});
}

TEST(Simulator, NobodyIsLetInDuringAnOutage) {
  Running sim(network({{"faults", json::array({{{"kind", "drop"}, {"ms", 3'600'000}}})}}));
  const auto client = sim.tcp();
  client.send(kEnq);
  EXPECT_TRUE(client.ended());
  // The listener closes in the same step as the connection, before control is served again.
  EXPECT_EQ(sim.control({{"cmd", "stats"}, {"plc", "p1"}})["faults"]["drop"], 1);
  EXPECT_FALSE(Client::tcp_opens(sim.port("p1")));
}

TEST(Simulator, DeadLineIsSilentUntilCleared) {
  Running sim(serial());
  sim.control({{"cmd", "fault"}, {"plc", "p1"}, {"kind", "dead"}});
  const auto client = sim.terminal();
  client.send(kForceM100);
  EXPECT_TRUE(client.receive(1, milliseconds(100)).empty());
  sim.control({{"cmd", "clear_faults"}, {"plc", "p1"}});
  EXPECT_EQ(client.ask(kEnq, 1), Bytes{0x06});
  EXPECT_EQ(sim.control({{"cmd", "get"}, {"plc", "p1"}, {"device", "M100"}})["values"],
            json::array({0}));
}

json link_station(const char* name, int station, json extra = json::object()) {
  json plc = {{"name", name},       {"protocol", "fx-computer-link"},
              {"pty", "p1"},        {"baud", 0},
              {"turnaround_ms", 0}, {"station", station}};
  plc.update(extra);
  return plc;
}
json modbus_unit(const char* name, int unit, json extra = json::object()) {
  json plc = {{"name", name}, {"protocol", "modbus-tcp"}, {"unit", unit}};
  plc.update(extra);
  return plc;
}
/// Remote RUN of a computer link station that is in RUN: refused with 18, a short reply.
Bytes remote_run(char station) {
  Bytes bytes{0x05, '0', static_cast<std::uint8_t>(station), 'F', 'F', 'R', 'R', '0'};
  append_hex(bytes, sum_of(ByteView(bytes).subspan(1)));
  return bytes;
}
Bytes refused_by(char station) {
  return {0x15, '0', static_cast<std::uint8_t>(station), 'F', 'F', '1', '8'};
}
/// Reads hr:0 over TCP.
Bytes modbus_read(std::uint8_t unit, std::uint8_t transaction = 1) {
  return {0, transaction, 0, 0, 0, 6, unit, 3, 0, 0, 0, 1};
}
Bytes modbus_data(std::uint8_t unit, std::uint8_t value, std::uint8_t transaction = 1) {
  return {0, transaction, 0, 0, 0, 5, unit, 3, 2, 0, value};
}

TEST(SharedLine, OnlyTheStationThatIsMeantAnswers) {
  Running sim(link_station("a", 1), link_station("b", 2));
  const auto client = sim.terminal();
  EXPECT_EQ(client.ask(remote_run('2'), 7), refused_by('2'));
  EXPECT_EQ(client.ask(remote_run('1'), 7), refused_by('1'));
  client.send(remote_run('3'));
  EXPECT_TRUE(client.receive(1, milliseconds(50)).empty());
  EXPECT_EQ(sim.control({{"cmd", "stats"}, {"plc", "a"}})["requests"]["control"], 1);
  EXPECT_EQ(sim.control({{"cmd", "stats"}, {"plc", "b"}})["requests"]["control"], 1);
}

TEST(SharedLine, DeadStationDoesNotSilenceItsNeighbour) {
  Running sim(link_station("a", 1), link_station("b", 2));
  sim.control({{"cmd", "fault"}, {"plc", "a"}, {"kind", "dead"}});
  const auto client = sim.terminal();
  client.send(remote_run('1'));
  EXPECT_EQ(client.ask(remote_run('2'), 7), refused_by('2'));
}

TEST(SharedLine, LateAnswerComesBehindTheNeighboursAnswer) {
  Running sim(link_station("a", 1, {{"faults", json::array({{{"kind", "late"}, {"ms", 200}}})}}),
              link_station("b", 2));
  const auto client = sim.terminal();
  client.send(remote_run('1'));
  EXPECT_EQ(client.ask(remote_run('2'), 7), refused_by('2'));
  EXPECT_EQ(client.receive(7), refused_by('1'));
}

TEST(SharedLine, DropEndsTheLineForAll) {
  Running sim(modbus_unit("p1", 1, {{"tcp", 0}}),
              modbus_unit("b", 2,
                          {{"with", "p1"},
                           {"memory", {{"hr:0", 7}}},
                           {"faults", json::array({{{"kind", "drop"}, {"ms", 0}}})}}));
  const auto client = sim.tcp();
  EXPECT_EQ(client.ask(modbus_read(1), 11), modbus_data(1, 0));
  client.send(modbus_read(2));
  EXPECT_TRUE(client.ended());
  EXPECT_EQ(sim.tcp().ask(modbus_read(2), 11), modbus_data(2, 7));
}

TEST(SharedLine, GlobalSignalReachesEveryStation) {
  Running sim(link_station("a", 1), link_station("b", 2));
  const auto client = sim.terminal();
  client.send(*from_hex("05 46 46 46 46 47 57 30 31 31 37"));
  EXPECT_EQ(client.ask(remote_run('1'), 7), refused_by('1'));
  EXPECT_EQ(client.ask(remote_run('2'), 7), refused_by('2'));
  for (const auto* name : {"a", "b"})
    EXPECT_EQ(sim.control({{"cmd", "get"}, {"plc", name}, {"device", "M8126"}})["values"],
              json::array({1}));
}

TEST(SharedLine, MessageWaitIsKeptAndCoversTheTurnaround) {
  Running sim(link_station("a", 0, {{"turnaround_ms", 20}}));
  const auto sent = Clock::now();
  // TT 0 with a wait of 150 ms.
  EXPECT_EQ(sim.terminal().ask(*from_hex("05 30 30 46 46 54 54 46 30 31 41 37 43"), 11).size(),
            11U);
  EXPECT_GE(Clock::now() - sent, milliseconds(150));
}

TEST(Gateway, AnswersForUnitsThatDoNot) {
  Running sim(modbus_unit("p1", 1, {{"tcp", 0}, {"gateway", true}}),
              modbus_unit("b", 2, {{"with", "p1"}}));
  sim.control({{"cmd", "fault"}, {"plc", "b"}, {"kind", "dead"}});
  const auto client = sim.tcp();
  EXPECT_EQ(client.ask(modbus_read(1), 11), modbus_data(1, 0));
  EXPECT_EQ(client.ask(modbus_read(2, 5), 9), (Bytes{0, 5, 0, 0, 0, 3, 2, 0x83, 0x0B}));
  EXPECT_EQ(client.ask(modbus_read(9, 6), 9), (Bytes{0, 6, 0, 0, 0, 3, 9, 0x83, 0x0B}));
  sim.control({{"cmd", "clear_faults"}, {"plc", "b"}});
  EXPECT_EQ(client.ask(modbus_read(2), 11), modbus_data(2, 0));
}

TEST(Gateway, WithoutOneAUnitThatIsNotThereIsSilent) {
  Running sim(modbus_unit("p1", 1, {{"tcp", 0}}));
  const auto client = sim.tcp();
  client.send(modbus_read(9));
  EXPECT_EQ(client.ask(modbus_read(1, 2), 11), modbus_data(1, 0, 2));
}

TEST(SerialModbus, BroadcastReachesEveryUnitAndNobodyAnswers) {
  const auto unit = [](const char* name, int number) {
    return json{{"name", name}, {"protocol", "modbus-rtu"}, {"pty", "p1"},
                {"baud", 0},    {"turnaround_ms", 0},       {"unit", number}};
  };
  Running sim(unit("a", 1), unit("b", 2));
  const auto client = sim.terminal();
  client.send(*from_hex("00 06 00 01 00 AA 59 A4"));
  EXPECT_EQ(client.ask(*from_hex("01 03 00 00 00 01 84 0A"), 7), *from_hex("01 03 02 00 00 B8 44"));
  for (const auto* name : {"a", "b"})
    EXPECT_EQ(sim.control({{"cmd", "get"}, {"plc", name}, {"device", "hr:1"}})["values"],
              json::array({0xAA}));
}

TEST(Simulator, LogFileHasALineForEveryRequest) {
  Running sim(serial());
  EXPECT_EQ(sim.terminal().ask(kForceM100, 1), Bytes{0x06});
  sim.stop();
  std::ifstream log(sim.path("log"));
  std::string line;
  ASSERT_TRUE(std::getline(log, line));
  const auto entry = json::parse(line);
  EXPECT_EQ(entry["plc"], "p1");
  EXPECT_EQ(entry["rx"], "02 37 36 34 30 38 03 30 43");
  EXPECT_EQ(entry["decision"], "ack");
  EXPECT_EQ(entry["tx"], "06");
  EXPECT_EQ(entry["device"], "M100");
  EXPECT_FALSE(std::getline(log, line));
}

TEST(Simulator, ControlSocketAnswersEveryLine) {
  Running sim(serial());
  const auto client = Client::local(sim.path("control"));
  const std::string lines = "{\"cmd\":\"stats\",\"plc\":\"p1\"}\nnonsense\n";
  client.send({reinterpret_cast<const std::uint8_t*>(lines.data()), lines.size()});
  std::string replies;
  while (std::count(replies.begin(), replies.end(), '\n') < 2) {
    const auto byte = client.receive(1);
    ASSERT_FALSE(byte.empty());
    replies += static_cast<char>(byte[0]);
  }
  const auto first = replies.find('\n');
  EXPECT_EQ(json::parse(replies.substr(0, first))["ok"], true);
  EXPECT_EQ(json::parse(replies.substr(first))["error"], "not JSON");
}

TEST(Simulator, QuitEndsTheRunAndRemovesWhatItMade) {
  Running sim(serial());
  EXPECT_TRUE(std::filesystem::is_symlink(sim.path("p1")));
  EXPECT_EQ(sim.control({{"cmd", "quit"}})["ok"], true);
  sim.stop();
  EXPECT_FALSE(std::filesystem::exists(std::filesystem::symlink_status(sim.path("p1"))));
  EXPECT_FALSE(std::filesystem::exists(sim.path("control")));
}

TEST(Simulator, LifetimeEndsTheRun) {
  const auto plcs = parse_config({{"plcs", json::array({network()})}});
  Simulator::Options options;
  options.lifetime = milliseconds(30);
  Simulator simulator(plcs, options);
  const auto start = Clock::now();
  simulator.run();
  EXPECT_GE(Clock::now() - start, milliseconds(30));
}

TEST(Simulator, LinesThatCannotBeOpenedAreErrors) {
  const auto open = [](const json& plc) {
    Simulator(parse_config({{"plcs", json::array({plc})}}), {});
  };
  EXPECT_THROW(open(serial({{"pty", "/nowhere/at/all"}})), std::system_error);
  Running sim(network());
  const auto port = sim.port("p1");
  try {
    open(network({{"tcp", port}}));
    ADD_FAILURE() << "the port was free";
  } catch (const std::system_error& error) {
    EXPECT_EQ(std::string(error.what()),
              "127.0.0.1:" + std::to_string(port) + ": Address already in use");
  }
  std::ofstream(sim.path("file")) << "no link";
  EXPECT_THROW(open(serial({{"pty", sim.path("file")}})), std::system_error);
}

}  // namespace
}  // namespace fxsim
