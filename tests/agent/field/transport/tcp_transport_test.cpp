#include "agent/field/transport/transport.h"

#include <gtest/gtest.h>

#include <asio/ip/tcp.hpp>
#include <asio/post.hpp>
#include <asio/read.hpp>
#include <asio/write.hpp>

#include "agent/field/transport/host_lookup.h"
#include "tests/agent/field/transport/blocking_transport.h"
#include "tests/agent/field/transport/open_files.h"
#include "tests/support/says.h"

namespace fxagent::test {
namespace {

using asio::ip::tcp;
using std::chrono::milliseconds;
using Clock = std::chrono::steady_clock;

/// A serial server on the loopback with blocking calls: it runs between calls of the transport.
struct TcpTransportTest : TransportTest {
  std::unique_ptr<Transport> stream(std::string host = "127.0.0.1") {
    const auto port = server.local_endpoint().port();
    return make_tcp_transport(io.get_executor(), {std::move(host), port});
  }
  /// Opens the stream and returns the peer's end.
  tcp::socket connect(Transport& transport) {
    const auto opened = open(transport);
    EXPECT_TRUE(opened) << opened.error().text;
    return server.accept();
  }
  static void say(tcp::socket& peer, const std::string& bytes) {
    asio::write(peer, asio::buffer(bytes));
  }

  asio::io_context server_io;
  tcp::acceptor server{server_io, tcp::endpoint(asio::ip::address_v4::loopback(), 0)};
};

struct TcpTransportConnected : TcpTransportTest {
  const std::unique_ptr<Transport> transport = stream();
  tcp::socket peer = connect(*transport);
};

TEST_F(TcpTransportConnected, BytesGoBothWays) {
  const std::string request = "\x05\x02\x03";
  const auto written = write(*transport, request);
  EXPECT_EQ(written.sent, 3U);
  EXPECT_FALSE(written.error);
  std::string heard(3, '\0');
  asio::read(peer, asio::buffer(heard));
  EXPECT_EQ(heard, request);
  say(peer, "\x06");
  EXPECT_EQ(read(*transport), "\x06");
}

TEST_F(TcpTransportTest, HostMayBeAName) {
  const auto transport = stream("localhost");
  tcp::socket peer = connect(*transport);
  say(peer, "hello");
  EXPECT_EQ(read(*transport), "hello");
}

TEST_F(TcpTransportTest, AddressThatDoesNotAnswerLeavesTimeForTheNextOne) {
  // The queue of 127.0.0.2 is full, so nothing answers the next connection request.
  const auto port = server.local_endpoint().port();
  tcp::acceptor full(server_io, tcp::v4());
  full.bind({asio::ip::make_address("127.0.0.2"), port});
  full.listen(0);
  tcp::socket first(server_io);
  first.connect(full.local_endpoint());
  const auto transport = stream("two.test");  // see host_lookup_test.cpp
  const auto deadline = Clock::now() + std::chrono::seconds(3);
  const auto opened = run_on(io, transport->open(deadline));
  ASSERT_TRUE(opened) << opened.error().text;
  EXPECT_LT(Clock::now(), deadline);
  tcp::socket peer = server.accept();
  say(peer, "hello");
  EXPECT_EQ(read(*transport), "hello");
}

TEST_F(TcpTransportTest, PortWhereNobodyListensIsLinkDown) {
  const auto transport = stream();
  const auto port = server.local_endpoint().port();
  server.close();
  const auto error = error_of(open(*transport));
  EXPECT_EQ(error.code, ErrorCode::link_down);
  expect_says(error.text, ": connection refused: is ");
  expect_says(error.text, "127.0.0.1:" + std::to_string(port));
  EXPECT_FALSE(transport->is_open());
}

TEST_F(TcpTransportConnected, ReadEndsAtItsDeadline) {
  EXPECT_EQ(read(*transport, milliseconds(10)), "timeout");
  say(peer, "late");
  EXPECT_EQ(read(*transport), "late");
  EXPECT_EQ(read(*transport, milliseconds(10)), "timeout");
}

TEST_F(TcpTransportTest, EarlierDeadlineAfterALaterOneHolds) {
  // One timer serves all reads. It was armed for the first read, which ended long before.
  const auto transport = stream();
  tcp::socket peer = connect(*transport);
  say(peer, "x");
  EXPECT_EQ(read(*transport, std::chrono::hours(1)), "x");
  EXPECT_EQ(read(*transport, milliseconds(10)), "timeout");
}

TEST_F(TcpTransportConnected, LaterDeadlineAfterAnEarlierOneHolds) {
  say(peer, "x");
  EXPECT_EQ(read(*transport, milliseconds(30)), "x");
  const auto began = Clock::now();
  EXPECT_EQ(read(*transport, milliseconds(60)), "timeout");
  EXPECT_GE(Clock::now() - began, milliseconds(60)) << "cut short by the deadline before it";
}

TEST_F(TcpTransportTest, PeerThatClosesIsLinkDown) {
  const auto transport = stream();
  connect(*transport).close();
  EXPECT_EQ(read(*transport), "link_down");
}

TEST_F(TcpTransportConnected, DiscardNoticesAPeerThatHasGoneBeforeAnythingIsSent) {
  say(peer, "stale reply");
  peer.close();
  run_until(io, [&] { return !transport->discard_input().has_value(); });
  EXPECT_FALSE(transport->is_open());
  EXPECT_EQ(error_of(transport->discard_input()).code, ErrorCode::link_down);
}

TEST_F(TcpTransportConnected, DiscardThrowsAwayWhatHasArrived) {
  EXPECT_EQ(transport->discard_input().value_or(Bytes(99)).size(), 0U);
  say(peer, "stale reply");
  std::size_t thrown_away = 0;
  run_until(io, [&] {
    thrown_away += transport->discard_input().value_or(Bytes{}).size();
    return thrown_away == 11;
  });
  say(peer, "new");
  EXPECT_EQ(read(*transport), "new");
}

TEST_F(TcpTransportTest, OpensAgainAfterALoss) {
  const auto transport = stream();
  connect(*transport).close();
  EXPECT_EQ(read(*transport), "link_down");
  tcp::socket peer = connect(*transport);
  say(peer, "here");
  EXPECT_EQ(read(*transport), "here");
}

TEST_F(TcpTransportConnected, PeerThatTakesNoMoreBytesEndsTheWrite) {
  const std::string flood(64 << 20, 0x55);
  const auto written = write(*transport, flood, milliseconds(50));
  ASSERT_TRUE(written.error);
  EXPECT_EQ(written.error->code, ErrorCode::link_down);
  EXPECT_GT(written.sent, 0U);
  EXPECT_LT(written.sent, flood.size());
}

TEST_F(TcpTransportConnected, ClosingEndsAWaitingRead) {
  asio::post(io, [&] { asio::post(io, [&] { transport->close(); }); });
  EXPECT_EQ(read(*transport, std::chrono::hours(1)), "link_down");
}

TEST_F(TcpTransportConnected, NothingKeepsTheThreadAfterClosing) {
  say(peer, "x");
  EXPECT_EQ(read(*transport, std::chrono::hours(1)), "x");
  transport->close();
  io.restart();
  io.run_for(std::chrono::seconds(10));
  EXPECT_TRUE(io.stopped());
}

TEST_F(TcpTransportTest, LastOpenFilesAreLeftToTheOthers) {
  const auto transport = stream();
  const auto next = static_cast<rlim_t>(server.native_handle()) + 20;
  {
    const OpenFiles allowed(next + kFilesNotForLinks / 2);
    const auto error = error_of(open(*transport));
    EXPECT_EQ(error.code, ErrorCode::link_down);
    expect_says(error.text, "open files");
    EXPECT_FALSE(transport->is_open());
  }
  EXPECT_TRUE(open(*transport));
}

}  // namespace
}  // namespace fxagent::test
