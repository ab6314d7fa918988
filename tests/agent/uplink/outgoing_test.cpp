#include "agent/uplink/outgoing.h"

#include <gtest/gtest.h>

#include "tests/agent/uplink/fake_broker.h"

namespace fxagent {
namespace {

using test::FakeBroker;

Publication to(std::string topic, int qos = 1) { return {.topic = std::move(topic), .qos = qos}; }

struct OutgoingTest : testing::Test, Outgoing::Sender {
  explicit OutgoingTest(std::string marker = {}) : outgoing_(broker_, std::move(marker)) {}
  void begin(std::uint32_t window = 20) {
    broker_.acknowledges = false;
    broker_.acknowledges_qos0 = true;  // its hand-over to the socket
    broker_.receive_maximum = window;
    broker_.connect(0, 10);
    broker_.take_events();
    outgoing_.begin(Connected{false, window});
  }
  void take() {
    for (const BrokerEvent& event : broker_.take_events()) {
      if (const auto* done = std::get_if<Delivered>(&event)) outgoing_.on(*done, {});
      if (const auto* failure = std::get_if<DeliveryFailed>(&event)) outgoing_.on(*failure, {});
    }
  }
  void acknowledge_next() {
    broker_.acknowledge_next();
    take();
  }
  std::vector<std::string> sent() const {
    std::vector<std::string> topics;
    for (const Publication& publication : broker_.log) topics.push_back(publication.topic);
    return topics;
  }

  void delivered(std::uint64_t id, SteadyTime) override { delivered_.push_back(id); }
  void failed(const DeliveryFailed& event, SteadyTime) override {
    failed_.push_back(event.id);
    reason_ = event.reason_code;
  }

  using Ids = std::vector<std::uint64_t>;
  FakeBroker broker_;
  Outgoing outgoing_;
  Ids delivered_;
  Ids failed_;
  int reason_ = 0;
};

TEST_F(OutgoingTest, GroupIsDeliveredWhenItsLastMessageIs) {
  begin();
  const std::uint64_t group = outgoing_.send_group(*this, {to("a"), to("b"), to("c")});
  broker_.acknowledge_next();
  acknowledge_next();
  EXPECT_TRUE(delivered_.empty());
  acknowledge_next();
  EXPECT_EQ(delivered_, Ids{group});
  EXPECT_TRUE(outgoing_.empty());
}

TEST_F(OutgoingTest, GroupFailsOnceWhenOneMessageFails) {
  begin();
  const std::uint64_t group = outgoing_.send_group(*this, {to("a"), to("b")});
  broker_.refuse_next(0x97);
  take();
  EXPECT_TRUE(failed_.empty());
  acknowledge_next();
  EXPECT_EQ(failed_, Ids{group});
  EXPECT_EQ(reason_, 0x97);
  EXPECT_TRUE(delivered_.empty());
}

TEST_F(OutgoingTest, GroupLargerThanTheWindowGoesOutInOrder) {
  begin(2);
  const std::uint64_t group =
      outgoing_.send_group(*this, {to("a"), to("b"), to("c"), to("d"), to("e")});
  EXPECT_FALSE(outgoing_.has_room());
  while (delivered_.empty()) {
    EXPECT_LE(broker_.open(), 2U);
    acknowledge_next();
  }
  EXPECT_EQ(delivered_, Ids{group});
  EXPECT_EQ(sent(), (std::vector<std::string>{"a", "b", "c", "d", "e"}));
  EXPECT_EQ(broker_.most_open, 2U);
}

TEST_F(OutgoingTest, MessageThatTheBrokerWouldNotAcceptFailsItsGroup) {
  begin();
  const std::uint64_t group = outgoing_.send_group(*this, {to("a"), to("+")});
  EXPECT_TRUE(outgoing_.fail_unsendable({}));
  broker_.acknowledge_all();
  take();
  EXPECT_EQ(failed_, Ids{group});
}

TEST_F(OutgoingTest, WithoutMarkersQos0IsDeliveredWithItsHandOver) {
  begin();
  const std::uint64_t id = outgoing_.send(*this, to("a", 0));
  take();
  EXPECT_EQ(delivered_, Ids{id});
}

struct OutgoingWithMarker : OutgoingTest {
  OutgoingWithMarker() : OutgoingTest("mark") {}
};

TEST_F(OutgoingWithMarker, AcknowledgedMarkerProvesWhatWasSentBeforeIt) {
  begin();
  const std::uint64_t first = outgoing_.send(*this, to("a", 0));
  outgoing_.note_sent({});
  const std::uint64_t second = outgoing_.send(*this, to("b", 0));
  outgoing_.note_sent({});  // one marker at a time
  take();
  EXPECT_TRUE(delivered_.empty());
  EXPECT_EQ(sent(), (std::vector<std::string>{"a", "mark", "b"}));
  acknowledge_next();
  EXPECT_EQ(delivered_, Ids{first});
  outgoing_.note_sent({});
  acknowledge_next();
  EXPECT_EQ(delivered_, (Ids{first, second}));
  outgoing_.note_sent({});
  EXPECT_EQ(sent().size(), 4U) << "nothing is left to prove";
}

TEST_F(OutgoingWithMarker, MarkersProveAGroupLargerThanTheWindow) {
  begin(2);
  std::vector<Publication> group(9, to("a", 0));
  const std::uint64_t id = outgoing_.send_group(*this, std::move(group));
  for (int i = 0; i < 9 && delivered_.empty(); ++i) {
    outgoing_.note_sent({});
    take();
    if (broker_.open() != 0) broker_.acknowledge_next();
    take();
  }
  EXPECT_EQ(delivered_, Ids{id});
  EXPECT_EQ(broker_.on("a").size(), 9U);
}

TEST_F(OutgoingWithMarker, MarkerProvesNothingThatWasHandedOverAfterIt) {
  begin(2);
  const std::uint64_t id = outgoing_.send_group(*this, {to("+", 0), to("a", 0), to("b", 0)});
  outgoing_.note_sent({});
  outgoing_.fail_unsendable({});  // makes room for b, behind the marker
  acknowledge_next();
  EXPECT_TRUE(failed_.empty());
  outgoing_.note_sent({});
  acknowledge_next();
  EXPECT_EQ(failed_, Ids{id});
}

TEST_F(OutgoingWithMarker, MarkerThatTheLibraryRejectsIsSentAgain) {
  begin();
  const std::uint64_t id = outgoing_.send(*this, to("a", 0));
  outgoing_.note_sent({});
  broker_.refuse_next(0);
  take();
  outgoing_.note_sent({});
  acknowledge_next();
  EXPECT_EQ(delivered_, Ids{id});
}

TEST_F(OutgoingWithMarker, RefusedMarkerHasArrivedToo) {
  begin();
  const std::uint64_t id = outgoing_.send_group(*this, {to("a", 0), to("b", 0)});
  outgoing_.note_sent({});
  broker_.refuse_next(0x87);
  take();
  EXPECT_EQ(delivered_, Ids{id});
}

TEST_F(OutgoingWithMarker, LostConnectionProvesNothing) {
  begin();
  outgoing_.send(*this, to("a", 0));
  outgoing_.note_sent({});
  outgoing_.forget();
  begin();
  take();
  EXPECT_TRUE(delivered_.empty());
  EXPECT_TRUE(outgoing_.empty());
  EXPECT_FALSE(outgoing_.unanswered_since().has_value());
}

TEST_F(OutgoingWithMarker, BrokerThatDoesNotAnswerAMarkerOwesAnAnswer) {
  begin();
  const SteadyTime now = SteadyTime{} + std::chrono::seconds(7);
  outgoing_.send(*this, to("a", 0));
  outgoing_.note_sent(now);
  take();
  EXPECT_EQ(outgoing_.unanswered_since(), now);
  acknowledge_next();
  EXPECT_FALSE(outgoing_.unanswered_since().has_value());
}

}  // namespace
}  // namespace fxagent
