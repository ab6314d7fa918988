// The bus returns no wrong value with good quality, no false ACK and no false NAK when answers are
// late, lost or duplicated, or belong to an earlier agent.
// The limits: an answer comes at most twice timeout_ms after its request. A duplicate follows its
// original directly. An unsolicited answer comes only while no request is pending. Modbus TCP has
// no limit.
#include "agent/field/bus/late_answers.h"

#include <gtest/gtest.h>

#include <asio/io_context.hpp>

#include "agent/field/bus/bus.h"
#include "protocol/catalog.h"
#include "protocol/plc.h"
#include "tests/agent/field/late_wire.h"
#include "tests/agent/field/on_io.h"
#include "tests/support/effort.h"

namespace fxagent::test {
namespace {

using std::chrono::milliseconds;
using Framing = modbus::Framing;

TEST(LateAnswers, AreAwaitedAsLongAgainAsTheTimeoutWithinLimits) {
  const SteadyTime ended{std::chrono::hours(1)};
  for (const auto& [timeout, awaited] : {std::pair{1, 100}, {300, 300}, {600'000, 5000}}) {
    LateAnswers late;
    late.given_up(LateAnswers::Owed::data, ended, milliseconds(timeout), 8);
    EXPECT_EQ(late.over_at(), ended + milliseconds(awaited)) << timeout;
  }
}

TEST(LateAnswers, TheLatestOfThemAndAnAckAreNotForgottenForANewerOne) {
  const SteadyTime ended{std::chrono::hours(1)};
  LateAnswers late;
  late.given_up(LateAnswers::Owed::acknowledgement, ended, milliseconds(900), 1);
  late.given_up(LateAnswers::Owed::data, ended + milliseconds(10), milliseconds(200), 8);
  EXPECT_EQ(late.owed(), LateAnswers::Owed::acknowledgement);
  EXPECT_EQ(late.over_at(), ended + milliseconds(900));
  late.settled();
  EXPECT_EQ(late.owed(), LateAnswers::Owed::none);
}

TEST(LateAnswers, MoreBytesThanAreOwedAreAnothers) {
  LateAnswers late;
  for (const std::uint32_t bytes : {1U, 8U})
    late.given_up(LateAnswers::Owed::data, SteadyTime{}, milliseconds(200), bytes);
  EXPECT_FALSE(late.add_received(4));
  EXPECT_FALSE(late.add_received(5));
  EXPECT_TRUE(late.add_received(1));
  late.settled();
  late.given_up(LateAnswers::Owed::data, SteadyTime{}, milliseconds(200), 8);
  EXPECT_FALSE(late.add_received(8)) << "the earlier ones are settled";
}

struct Line {
  std::string name;
  std::string protocol;
  std::string station_key;  ///< empty: one device on the line
  std::function<std::unique_ptr<Dialect>()> dialect;
  std::int64_t format = 1;
  EnquirePolicy enquire = EnquirePolicy::open;
};
std::ostream& operator<<(std::ostream& out, const Line& line) { return out << line.name; }

/// Factors by which the bus and the wire keep the limit; 1 is correct.
struct Limit {
  double listening = 1;  ///< by the bus, before the first request
  double late = 1;       ///< by the wire, for the latest answer
};

/// One wire, and a succession of agents that use it.
class Agents final {
 public:
  Agents(const Line& line, std::uint32_t seed, Limit limit)
      : dialect_(line.dialect()), numbered_(line.protocol == "modbus-tcp") {
    std::mt19937 random(seed);
    const auto timeout = [&] { return milliseconds(50 * (1 + static_cast<int>(random() % 20))); };
    std::map<unsigned, milliseconds> timeouts;
    std::map<unsigned, milliseconds> latest;
    for (unsigned number = 0; number < (line.station_key.empty() ? 1U : 2U); ++number) {
      const unsigned station = line.station_key.empty() ? 0U : number + 1;
      timeouts[station] = std::max(timeout(), LateAnswers::kLeast);
      latest[station] = milliseconds(static_cast<std::int64_t>(
          2.0 * limit.late * static_cast<double>(timeouts[station].count())));
      listening_ = std::max(listening_, 2 * timeouts[station]);
      add_device(line, station, timeouts[station]);
    }
    listening_ = milliseconds(
        static_cast<std::int64_t>(static_cast<double>(listening_.count()) * limit.listening));
    if (numbered_) listening_ = milliseconds(0);
    wire_ = std::make_unique<LateWire>(*dialect_, timeouts, latest, seed);
    wire_->keeps_what_came = random() % 2 == 0;
    wire_->answers_end_with_it = numbered_;
  }

  /// Sends this many requests. Returns how often an answer to another request was accepted.
  int wrong_after(int questions) {
    int wrong = 0;
    for (int i = 0; i < questions; ++i) {
      if (bus_ == nullptr || wire_->now >= wire_->killed_at) begin_anew();
      if (wire_->one_in(25)) bus_->close();
      if (wire_->one_in(2)) wire_->wait(wire_->now + milliseconds(wire_->random_below(300)));
      if (!numbered_ && wire_->one_in(60)) wire_->disturb(station());
      if (!bus_->is_open()) run_on(io_, bus_->open());
      wrong += ask() ? 0 : 1;
    }
    return wrong;
  }
  int believed() const { return believed_; }

 private:
  struct Device {
    std::shared_ptr<const Codec> codec;
    Station station;
    unsigned number = 0;
  };

  void add_device(const Line& line, unsigned number, milliseconds timeout) {
    const ProtocolInfo& info = *find_protocol(line.protocol);
    Options options = default_options(info);
    if (!line.station_key.empty()) options[line.station_key] = std::int64_t{number};
    if (line.protocol == "fx-computer-link") options["format"] = line.format;
    auto made = info.make(options);
    ASSERT_TRUE(made) << made.error().text;
    Device device;
    device.codec = *made;
    if (const PlcServices* plc = device.codec->plc()) device.codec = plc->with_model("FX3U");
    device.number = number;
    device.station.timeout = timeout;
    device.station.enquire = line.enquire;
    devices_.push_back(std::move(device));
    modbus_ = line.protocol.starts_with("modbus");
  }

  void begin_anew() {
    bus_.reset();
    if (numbered_) wire_->take_arrived();
    wire_->killed_at =
        wire_->one_in(2) ? wire_->now + milliseconds(wire_->random_below(6000)) : SteadyTime::max();
    for (Device& device : devices_) device.station.handshake_in = 0;
    bus_ = std::make_unique<Bus>(io_.get_executor(),
                                 std::make_unique<LateTransport>(io_.get_executor(), *wire_),
                                 std::chrono::nanoseconds(0), listening_);
  }

  unsigned station() { return devices_[pick()].number; }
  std::size_t pick() {
    return static_cast<std::size_t>(wire_->random_below(static_cast<int>(devices_.size())));
  }

  /// Sends one request. Returns false if the bus accepted a wrong answer.
  bool ask() {
    Device& device = devices_[pick()];
    device.station.codec = device.codec;
    const bool writes = wire_->one_in(3);
    const std::string place =
        modbus_ ? (wire_->one_in(2) ? "hr:100" : "hr:200") : (wire_->one_in(2) ? "D100" : "D200");
    Span span = device.codec->addresses().parse_address(place, {})->span;
    if (!writes && wire_->one_in(4)) span.bits *= 2;
    const std::uint8_t way = device.codec->addresses().read_ways(span.space).back().way;
    const Request request = writes ? Request(Write{span, word(50)}) : Request(Read{span, way});
    const Exchange exchange =
        run_on(io_, bus_->exchange(device.station, request, SteadyTime::max()));
    const bool is_dead = wire_->now >= wire_->killed_at;
    if (is_dead || !exchange.has_answer() || exchange.doubted) return true;
    if (!exchange.sent) return exchange.is_nak();  // answer to an enquiry: proves nothing
    ++believed_;
    const Deed& deed = wire_->last();
    if (exchange.is_nak()) return deed.refused;
    if (writes) return exchange.is_ack() && deed.written;
    Bytes expected;
    for (std::uint32_t i = 0; i < span.bits / 16; ++i)
      expected = joined(expected, word(deed.value));
    return exchange.reply.image == expected;
  }

  asio::io_context io_;
  std::unique_ptr<Dialect> dialect_;
  const bool numbered_;
  bool modbus_ = false;
  milliseconds listening_{0};
  std::vector<Device> devices_;
  std::unique_ptr<LateWire> wire_;
  std::unique_ptr<Bus> bus_;
  int believed_ = 0;
};

struct LateAnswersOn : ::testing::TestWithParam<Line> {
  static constexpr int kQuestions = 60;

  int wrong_in(int seed, Limit limit) {
    Agents agents(GetParam(), static_cast<std::uint32_t>(seed), limit);
    const int wrong = agents.wrong_after(kQuestions);
    believed_ += agents.believed();
    return wrong;
  }
  /// Returns true if a wrong answer is accepted in any of many plants.
  bool is_found(Limit limit) {
    const bool numbered = GetParam().protocol == "modbus-tcp";
    const int most = numbered ? effort(50) : 4000;
    for (int seed = 1; seed <= most; ++seed)
      if (wrong_in(seed, limit) > 0) return true;
    return false;
  }
  /// False for numbered answers: they are distinguishable on any line.
  bool must_be_found() const { return GetParam().protocol != "modbus-tcp"; }
  int believed_ = 0;
};
/// An enquiry is itself a barrier: a wrong answer passes it in one plant of a thousand.
class LateAnswersWithoutAnEnquiry : public LateAnswersOn {};

TEST_P(LateAnswersOn, AreNeverBelievedWithinTheLimit) {
  constexpr int kPlants = effort(150);
  for (int seed = 1; seed <= kPlants; ++seed) EXPECT_EQ(wrong_in(seed, {}), 0) << "seed " << seed;
  EXPECT_GT(believed_, kPlants * kQuestions / 5) << "it is no proof to believe nothing";
}

// The strength of the test: it fails when any single part of the rule is removed.
TEST_P(LateAnswersWithoutAnEnquiry, AreFoundWhereALineDoesNotListenBeforeItsFirstQuestion) {
  EXPECT_EQ(is_found({.listening = 0}), must_be_found());
}

TEST_P(LateAnswersWithoutAnEnquiry, AreFoundWhereALineListensForHalfTheTime) {
  EXPECT_EQ(is_found({.listening = 0.5}), must_be_found());
}

TEST_P(LateAnswersWithoutAnEnquiry, AreFoundWhereTheyComeLaterThanTheLimit) {
  EXPECT_EQ(is_found({.late = 1.5}), must_be_found());
}

template <Framing kFraming>
std::unique_ptr<Dialect> modbus_dialect() {
  return std::make_unique<ModbusDialect>(kFraming);
}

const Line kEnquiredPort{"ProgrammingPort", "fx-programming-port", "",
                         [] { return std::make_unique<PortDialect>(); }};
const Line kOthers[] = {{"ProgrammingPortThatIsNotEnquired", "fx-programming-port", "",
                         [] { return std::make_unique<PortDialect>(); }, 1, EnquirePolicy::never},
                        {"ComputerLink1", "fx-computer-link", "station",
                         [] { return std::make_unique<LinkDialect>(false); }, 1},
                        {"ComputerLink4", "fx-computer-link", "station",
                         [] { return std::make_unique<LinkDialect>(true); }, 4},
                        {"ModbusRtu", "modbus-rtu", "unit", modbus_dialect<Framing::rtu>},
                        {"ModbusAscii", "modbus-ascii", "unit", modbus_dialect<Framing::ascii>},
                        {"ModbusTcp", "modbus-tcp", "unit", modbus_dialect<Framing::tcp>}};

constexpr auto kNameOf = [](const auto& line) { return line.param.name; };
INSTANTIATE_TEST_SUITE_P(EnquiredPort, LateAnswersOn, ::testing::Values(kEnquiredPort), kNameOf);
INSTANTIATE_TEST_SUITE_P(EachProtocol, LateAnswersOn, ::testing::ValuesIn(kOthers), kNameOf);
INSTANTIATE_TEST_SUITE_P(EachProtocol, LateAnswersWithoutAnEnquiry, ::testing::ValuesIn(kOthers),
                         kNameOf);

}  // namespace
}  // namespace fxagent::test
