#include "agent/field/transport/transport.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <array>
#include <asio/ip/udp.hpp>
#include <asio/post.hpp>

#include "tests/agent/field/transport/blocking_transport.h"
#include "tests/agent/field/transport/open_files.h"
#include "tests/support/says.h"

namespace fxagent::test {
namespace {

using asio::ip::udp;
using std::chrono::milliseconds;
using Clock = std::chrono::steady_clock;

/// A device on the loopback with blocking calls: it runs between calls of the transport.
struct UdpTransportTest : TransportTest {
  std::unique_ptr<Transport> channel(std::string host = "127.0.0.1", std::uint16_t own = 0) {
    const auto port = device.local_endpoint().port();
    return make_udp_transport(io.get_executor(), {std::move(host), port, own});
  }
  std::unique_ptr<Transport> opened() {
    auto made = channel();
    open_well(*made);
    return made;
  }
  /// Receives a text and returns its sender.
  udp::endpoint hear(std::string& text) {
    std::array<char, 65536> into{};
    udp::endpoint from;
    const std::size_t count = device.receive_from(asio::buffer(into), from);
    text.assign(into.data(), count);
    return from;
  }
  udp::endpoint asked(Transport& transport) {
    EXPECT_FALSE(write(transport, "question").error);
    std::string text;
    const udp::endpoint from = hear(text);
    EXPECT_EQ(text, "question");
    return from;
  }
  void say(const udp::endpoint& to, const std::string& text) {
    device.send_to(asio::buffer(text), to);
  }

  asio::io_context device_io;
  udp::socket device{device_io, udp::endpoint(asio::ip::address_v4::loopback(), 0)};
};

TEST_F(UdpTransportTest, DatagramsGoBothWays) {
  const auto transport = channel();
  EXPECT_FALSE(transport->is_open());
  open_well(*transport);
  EXPECT_TRUE(transport->is_open());
  EXPECT_TRUE(transport->has_datagrams());
  const auto written = write(*transport, "read D100");
  EXPECT_EQ(written.sent, 9U);
  EXPECT_FALSE(written.error);
  std::string text;
  const udp::endpoint agent = hear(text);
  EXPECT_EQ(text, "read D100");
  say(agent, "234");
  EXPECT_EQ(read(*transport), "234");
}

TEST_F(UdpTransportTest, HostMayBeAName) {
  const auto transport = channel("localhost");
  // The name may have another address, without a device: then the transport tries the next one.
  for (int attempt = 0; attempt < 4; ++attempt) {
    open_well(*transport);
    EXPECT_FALSE(write(*transport, "question").error);
    if (read(*transport, milliseconds(50)) == "timeout") break;
  }
  std::string text;
  say(hear(text), "hello");
  EXPECT_EQ(read(*transport), "hello");
  open_well(*transport);
  say(asked(*transport), "the address that answered stays");
  EXPECT_EQ(read(*transport), "the address that answered stays");
}

TEST_F(UdpTransportTest, Ipv6) {
  asio::error_code none;
  const udp::endpoint here(asio::ip::address_v6::loopback(), 0);
  udp::socket sixth(device_io);
  sixth.open(here.protocol(), none);
  sixth.bind(here, none);
  if (none) GTEST_SKIP() << "no IPv6 on the loopback: sysctl net.ipv6.conf.lo.disable_ipv6=0";
  const auto transport =
      make_udp_transport(io.get_executor(), {"::1", sixth.local_endpoint().port(), 0});
  open_well(*transport);
  EXPECT_FALSE(write(*transport, "question").error);
  std::array<char, 64> into{};
  udp::endpoint from;
  sixth.receive_from(asio::buffer(into), from);
  sixth.send_to(asio::buffer("v6", 2), from);
  EXPECT_EQ(read(*transport), "v6");
}

TEST_F(UdpTransportTest, NoMoreOpenFilesNamesTheCure) {
  const auto transport = channel();
  const int next = ::dup(STDERR_FILENO);  // the lowest number that is free
  ::close(next);
  const OpenFiles allowed(static_cast<rlim_t>(next));
  expect_says(error_of(open(*transport)).text, "LimitNOFILE");
}

struct UdpTransportOpened : UdpTransportTest {
  const std::unique_ptr<Transport> transport = opened();
};

TEST_F(UdpTransportOpened, AnswersOfOthersAreNotTaken) {
  const udp::endpoint agent = asked(*transport);
  udp::socket same_host(device_io, udp::endpoint(asio::ip::address_v4::loopback(), 0));
  udp::socket other_host(device_io, udp::endpoint(asio::ip::make_address("127.0.0.2"),
                                                  device.local_endpoint().port()));
  same_host.send_to(asio::buffer("another port", 12), agent);
  other_host.send_to(asio::buffer("another address", 15), agent);
  say(agent, "its own");
  EXPECT_EQ(read(*transport), "its own");
  EXPECT_EQ(read(*transport, milliseconds(20)), "timeout");
  EXPECT_TRUE(transport->discard_input().value_or(Bytes(1)).empty());
}

TEST_F(UdpTransportOpened, DatagramLongerThanTheBufferComesInPartsAndNothingOfTheNextWithIt) {
  const udp::endpoint agent = asked(*transport);
  say(agent, "0123456789");
  say(agent, "next");
  EXPECT_EQ(read(*transport, kWithin, 4), "0123");
  EXPECT_TRUE(transport->has_rest());
  EXPECT_EQ(read(*transport, kWithin, 4), "4567");
  EXPECT_TRUE(transport->has_rest());
  EXPECT_EQ(read(*transport, kWithin, 4), "89");
  EXPECT_FALSE(transport->has_rest());
  EXPECT_EQ(read(*transport), "next");
}

TEST_F(UdpTransportOpened, LongAnswersAreWhole) {
  const udp::endpoint agent = asked(*transport);
  say(agent, std::string(8192, 'x'));
  EXPECT_EQ(read(*transport, kWithin, 10000).size(), 8192U);
  say(agent, std::string(60000, 'x'));
  EXPECT_EQ(read(*transport, kWithin, 65536).size(), 8192U) << "no frame is as long";
}

TEST_F(UdpTransportOpened, DatagramWithoutAByteIsPassedOver) {
  const udp::endpoint agent = asked(*transport);
  say(agent, "");
  say(agent, "answer");
  EXPECT_EQ(read(*transport), "answer");
  say(agent, "");
  EXPECT_EQ(read(*transport, milliseconds(20)), "timeout");
  say(agent, "");
  EXPECT_TRUE(transport->discard_input().has_value());
  EXPECT_TRUE(transport->is_open());
}

TEST_F(UdpTransportOpened, DatagramsWithoutAByteDoNotHoldUpItsDeadline) {
  const udp::endpoint agent = asked(*transport);
  for (int i = 0; i < 3; ++i) say(agent, "");
  say(agent, "too late");
  EXPECT_EQ(read(*transport, milliseconds(-1)), "timeout");
  EXPECT_EQ(read(*transport), "too late");
}

TEST_F(UdpTransportOpened, EachPortIsAnotherThanTheOneBefore) {
  unsigned short before = 0;
  for (int i = 0; i < 20; ++i) {
    const auto port = asked(*transport).port();
    EXPECT_NE(port, before);
    before = port;
    ASSERT_TRUE(transport->renew());
  }
}

TEST_F(UdpTransportOpened, ReadEndsAtItsDeadline) {
  const auto began = Clock::now();
  EXPECT_EQ(read(*transport, milliseconds(30)), "timeout");
  EXPECT_GE(Clock::now() - began, milliseconds(30));
  EXPECT_TRUE(transport->is_open());
}

TEST_F(UdpTransportTest, PortWhereNobodyListensIsLinkDownInWords) {
  const auto transport = channel();
  const std::string place = "127.0.0.1:" + std::to_string(device.local_endpoint().port());
  device.close();
  open_well(*transport);
  EXPECT_FALSE(write(*transport, "question").error) << "it left; what becomes of it is told later";
  EXPECT_EQ(read(*transport), "link_down");
  EXPECT_EQ(read_error.find(place + ": the device has no such UDP port"), 0U) << read_error;
  // The refusal of the first request arrives with the next one, which was not sent.
  EXPECT_FALSE(write(*transport, "question").error);
  run_until(io, [&] { return !transport->discard_input().has_value(); });
  EXPECT_FALSE(transport->is_open());
}

TEST_F(UdpTransportTest, QuestionThatMeetsTheRefusalOfTheOneBeforeWasNotSent) {
  const auto transport = channel();
  device.close();
  open_well(*transport);
  EXPECT_FALSE(write(*transport, "question").error);
  // On the loopback the refusal has arrived when the call returns.
  const auto next = write(*transport, "next");
  ASSERT_TRUE(next.error);
  EXPECT_EQ(next.error->code, ErrorCode::link_down);
  EXPECT_EQ(next.sent, 0U);
}

TEST_F(UdpTransportTest, FixedPortIsTakenAndKept) {
  std::uint16_t own = 0;
  {
    const udp::socket taken(device_io, udp::endpoint(udp::v4(), 0));
    own = taken.local_endpoint().port();
  }
  const auto transport = channel("127.0.0.1", own);
  EXPECT_FALSE(transport->can_renew());
  for (int i = 0; i < 2; ++i) {
    open_well(*transport);
    EXPECT_EQ(asked(*transport).port(), own);
    EXPECT_TRUE(transport->renew());
    EXPECT_EQ(asked(*transport).port(), own);
  }
}

TEST_F(UdpTransportTest, FixedPortThatAnotherHasIsNamedWithTheCure) {
  const udp::socket taken(device_io, udp::endpoint(udp::v4(), 0));
  const auto own = taken.local_endpoint().port();
  const auto transport = channel("127.0.0.1", own);
  const auto error = error_of(open(*transport));
  EXPECT_EQ(error.code, ErrorCode::link_down);
  expect_says(error.text, "local_port " + std::to_string(own));
  EXPECT_FALSE(transport->is_open());
}

TEST_F(UdpTransportOpened, WhatCameToAFixedPortBeforeItWasOpenIsGone) {
  const udp::endpoint agent = asked(*transport);
  transport->close();
  const auto again = channel("127.0.0.1", agent.port());
  udp::socket foreign(device_io, udp::endpoint(asio::ip::address_v4::loopback(), 0));
  foreign.send_to(asio::buffer("early", 5), {asio::ip::address_v4::loopback(), agent.port()});
  open_well(*again);
  EXPECT_EQ(read(*again, milliseconds(20)), "timeout");
}

TEST_F(UdpTransportTest, AfterItIsRenewedNoAnswerToAnEarlierQuestionComes) {
  const auto transport = channel();
  EXPECT_TRUE(transport->can_renew());
  open_well(*transport);
  const udp::endpoint before = asked(*transport);
  say(before, "waits");
  ASSERT_TRUE(transport->renew());
  EXPECT_TRUE(transport->is_open());
  say(before, "late");
  const udp::endpoint after = asked(*transport);
  EXPECT_NE(after.port(), before.port());
  say(before, "very late");
  say(after, "new");
  EXPECT_EQ(read(*transport), "new");
  EXPECT_EQ(read(*transport, milliseconds(20)), "timeout");
}

TEST_F(UdpTransportOpened, PortThatWasNotAskedFromIsKept) {
  const int unused = 3;
  for (int i = 0; i < unused; ++i) ASSERT_TRUE(transport->renew());
  const udp::endpoint agent = asked(*transport);
  say(agent, "here");
  EXPECT_EQ(read(*transport), "here");
}

TEST_F(UdpTransportOpened, DiscardThrowsAwayWhatHasArrived) {
  EXPECT_EQ(transport->discard_input().value_or(Bytes(99)).size(), 0U);
  const udp::endpoint agent = asked(*transport);
  say(agent, "stale");
  say(agent, "answer");
  std::size_t thrown_away = 0;
  run_until(io, [&] {
    thrown_away += transport->discard_input().value_or(Bytes{}).size();
    return thrown_away == 11;
  });
  say(agent, "long answer");
  EXPECT_EQ(read(*transport, kWithin, 4), "long");
  EXPECT_EQ(transport->discard_input().value_or(Bytes{}).size(), 7U) << "the rest of a datagram";
  say(agent, "new");
  EXPECT_EQ(read(*transport), "new");
}

TEST_F(UdpTransportOpened, ClosingEndsAWaitingRead) {
  asio::post(io, [&] { asio::post(io, [&] { transport->close(); }); });
  EXPECT_EQ(read(*transport, std::chrono::hours(1)), "link_down");
  EXPECT_EQ(read_error.find("127.0.0.1:"), 0U) << read_error;
  EXPECT_FALSE(transport->is_open());
  EXPECT_FALSE(transport->discard_input());
}

TEST_F(UdpTransportOpened, NothingKeepsTheThreadAfterClosing) {
  say(asked(*transport), "x");
  EXPECT_EQ(read(*transport, std::chrono::hours(1)), "x");
  transport->close();
  io.restart();
  io.run_for(std::chrono::seconds(10));
  EXPECT_TRUE(io.stopped());
}

}  // namespace
}  // namespace fxagent::test
