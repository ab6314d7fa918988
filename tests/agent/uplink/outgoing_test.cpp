#include "agent/uplink/outgoing.h"

#include <gtest/gtest.h>

#include "tests/agent/uplink/fake_broker.h"

namespace fxagent {
namespace {

using test::FakeBroker;

Publication to(std::string topic, int qos = 1) {
  Publication publication;
  publication.topic = std::move(topic);
  publication.qos = qos;
  return publication;
}

class OutgoingTest : public testing::Test, public Outgoing::Sender {
 protected:
  void begin(Outgoing& outgoing, std::uint32_t window = 20) {
    broker_.acknowledges = false;
    broker_.acknowledges_qos0 = true;  // its hand-over to the socket
    broker_.receive_maximum = window;
    broker_.connect(0, 10);
    broker_.take_events();
    outgoing.begin(Connected{false, window});
  }
  void take(Outgoing& outgoing) {
    for (const BrokerEvent& event : broker_.take_events()) {
      if (const auto* done = std::get_if<Delivered>(&event)) outgoing.on(*done, {});
      if (const auto* failure = std::get_if<DeliveryFailed>(&event)) outgoing.on(*failure, {});
    }
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
  Ids delivered_;
  Ids failed_;
  int reason_ = 0;
};

TEST_F(OutgoingTest, GroupIsDeliveredWhenItsLastMessageIs) {
  Outgoing outgoing(broker_);
  begin(outgoing);
  const std::uint64_t group = outgoing.send(*this, {to("a"), to("b"), to("c")});
  broker_.acknowledge_next();
  broker_.acknowledge_next();
  take(outgoing);
  EXPECT_TRUE(delivered_.empty());
  broker_.acknowledge_next();
  take(outgoing);
  EXPECT_EQ(delivered_, Ids{group});
  EXPECT_TRUE(outgoing.empty());
}

TEST_F(OutgoingTest, GroupFailsOnceWhenOneMessageFails) {
  Outgoing outgoing(broker_);
  begin(outgoing);
  const std::uint64_t group = outgoing.send(*this, {to("a"), to("b")});
  broker_.refuse_next(0x97);
  take(outgoing);
  EXPECT_TRUE(failed_.empty());
  broker_.acknowledge_next();
  take(outgoing);
  EXPECT_EQ(failed_, Ids{group});
  EXPECT_EQ(reason_, 0x97);
  EXPECT_TRUE(delivered_.empty());
}

TEST_F(OutgoingTest, GroupLargerThanTheWindowGoesOutInOrder) {
  Outgoing outgoing(broker_);
  begin(outgoing, 2);
  const std::uint64_t group = outgoing.send(*this, {to("a"), to("b"), to("c"), to("d"), to("e")});
  EXPECT_FALSE(outgoing.has_room());
  while (delivered_.empty()) {
    EXPECT_LE(broker_.open(), 2U);
    broker_.acknowledge_next();
    take(outgoing);
  }
  EXPECT_EQ(delivered_, Ids{group});
  EXPECT_EQ(sent(), (std::vector<std::string>{"a", "b", "c", "d", "e"}));
  EXPECT_EQ(broker_.most_open, 2U);
}

TEST_F(OutgoingTest, MessageThatTheBrokerWouldNotAcceptFailsItsGroup) {
  Outgoing outgoing(broker_);
  begin(outgoing);
  const std::uint64_t group = outgoing.send(*this, {to("a"), to("+")});
  EXPECT_TRUE(outgoing.fail_unsendable({}));
  broker_.acknowledge_all();
  take(outgoing);
  EXPECT_EQ(failed_, Ids{group});
}

TEST_F(OutgoingTest, WithoutMarkersQos0IsDeliveredWithItsHandOver) {
  Outgoing outgoing(broker_);
  begin(outgoing);
  const std::uint64_t id = outgoing.send(*this, to("a", 0));
  take(outgoing);
  EXPECT_EQ(delivered_, Ids{id});
}

TEST_F(OutgoingTest, AcknowledgedMarkerProvesWhatWasSentBeforeIt) {
  Outgoing outgoing(broker_, "mark");
  begin(outgoing);
  const std::uint64_t first = outgoing.send(*this, to("a", 0));
  outgoing.note_sent({});
  const std::uint64_t second = outgoing.send(*this, to("b", 0));
  outgoing.note_sent({});  // one marker at a time
  take(outgoing);
  EXPECT_TRUE(delivered_.empty());
  EXPECT_EQ(sent(), (std::vector<std::string>{"a", "mark", "b"}));
  broker_.acknowledge_next();
  take(outgoing);
  EXPECT_EQ(delivered_, Ids{first});
  outgoing.note_sent({});
  broker_.acknowledge_next();
  take(outgoing);
  EXPECT_EQ(delivered_, (Ids{first, second}));
  outgoing.note_sent({});
  EXPECT_EQ(sent().size(), 4U) << "nothing is left to prove";
}

TEST_F(OutgoingTest, MarkersProveAGroupLargerThanTheWindow) {
  Outgoing outgoing(broker_, "mark");
  begin(outgoing, 2);
  std::vector<Publication> group(9, to("a", 0));
  const std::uint64_t id = outgoing.send(*this, std::move(group));
  for (int i = 0; i < 9 && delivered_.empty(); ++i) {
    outgoing.note_sent({});
    take(outgoing);
    if (broker_.open() != 0) broker_.acknowledge_next();
    take(outgoing);
  }
  EXPECT_EQ(delivered_, Ids{id});
  EXPECT_EQ(broker_.on("a").size(), 9U);
}

TEST_F(OutgoingTest, MarkerProvesNothingThatWasHandedOverAfterIt) {
  Outgoing outgoing(broker_, "mark");
  begin(outgoing, 2);
  const std::uint64_t id = outgoing.send(*this, {to("+", 0), to("a", 0), to("b", 0)});
  outgoing.note_sent({});
  outgoing.fail_unsendable({});  // makes room for b, behind the marker
  broker_.acknowledge_next();
  take(outgoing);
  EXPECT_TRUE(failed_.empty());
  outgoing.note_sent({});
  broker_.acknowledge_next();
  take(outgoing);
  EXPECT_EQ(failed_, Ids{id});
}

TEST_F(OutgoingTest, MarkerThatTheLibraryRejectsIsSentAgain) {
  Outgoing outgoing(broker_, "mark");
  begin(outgoing);
  const std::uint64_t id = outgoing.send(*this, to("a", 0));
  outgoing.note_sent({});
  broker_.refuse_next(0);
  take(outgoing);
  outgoing.note_sent({});
  broker_.acknowledge_next();
  take(outgoing);
  EXPECT_EQ(delivered_, Ids{id});
}

TEST_F(OutgoingTest, RefusedMarkerHasArrivedToo) {
  Outgoing outgoing(broker_, "mark");
  begin(outgoing);
  const std::uint64_t id = outgoing.send(*this, {to("a", 0), to("b", 0)});
  outgoing.note_sent({});
  broker_.refuse_next(0x87);
  take(outgoing);
  EXPECT_EQ(delivered_, Ids{id});
}

TEST_F(OutgoingTest, LostConnectionProvesNothing) {
  Outgoing outgoing(broker_, "mark");
  begin(outgoing);
  outgoing.send(*this, to("a", 0));
  outgoing.note_sent({});
  outgoing.forget();
  begin(outgoing);
  take(outgoing);
  EXPECT_TRUE(delivered_.empty());
  EXPECT_TRUE(outgoing.empty());
  EXPECT_FALSE(outgoing.unanswered_since().has_value());
}

TEST_F(OutgoingTest, BrokerThatDoesNotAnswerAMarkerOwesAnAnswer) {
  Outgoing outgoing(broker_, "mark");
  begin(outgoing);
  const SteadyTime now = SteadyTime{} + std::chrono::seconds(7);
  outgoing.send(*this, to("a", 0));
  outgoing.note_sent(now);
  take(outgoing);
  EXPECT_EQ(outgoing.unanswered_since(), now);
  broker_.acknowledge_next();
  take(outgoing);
  EXPECT_FALSE(outgoing.unanswered_since().has_value());
}

}  // namespace
}  // namespace fxagent
