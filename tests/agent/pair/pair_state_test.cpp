#include "agent/pair/pair_state.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <random>

namespace fxagent {
namespace {

using std::chrono::milliseconds;
using Action = PairState::Action;

constexpr milliseconds kQuiet{1200};
constexpr BootTime kStart = std::chrono::hours(1);

BootTime at(int ms) { return kStart + milliseconds(ms); }

/// A gateway and what it was told to do.
struct Gateway {
  explicit Gateway(const std::string& member = "a", const std::string& boot = "boot-a")
      : peers({member, boot, kQuiet}), state(kQuiet, peers) {}

  bool steps(int ms, Action wanted) {
    const auto actions = state.step(at(ms));
    return std::ranges::find(actions, wanted) != actions.end();
  }
  /// Claims at `ms`; its first heartbeat is acknowledged at once.
  void claim(int ms) {
    state.lease_began(at(ms));
    beat(ms);
    state.agent_began();
  }
  void beat(int ms) {
    state.step(at(ms));
    state.heartbeat_sent(++id, at(ms));
    state.heartbeat_acknowledged(id);
  }

  PairPeers peers;
  PairState state;
  std::uint64_t id = 0;
};
struct JoinedGateway : Gateway {
  explicit JoinedGateway(const std::string& member = "a", const std::string& boot = "boot-a")
      : Gateway(member, boot) {
    peers.joined(at(0));
  }
};

struct PairStateTest : ::testing::Test {
  JoinedGateway a;
};

TEST_F(PairStateTest, StatusThatIsRepeatedIsNotAnswered) {
  EXPECT_TRUE(a.steps(0, Action::publish_status));
  a.state.heard({.member = "b", .boot = "boot-b", .role = "standby"}, at(10));
  EXPECT_TRUE(a.steps(10, Action::publish_status)) << "the first one: it may have missed ours";
  a.state.heard({.member = "b", .boot = "boot-b", .role = "standby"}, at(20));
  EXPECT_FALSE(a.steps(20, Action::publish_status)) << "the two would answer each other forever";
}

TEST_F(PairStateTest, GatewayWhoseSessionBeganAnewIsThereAgain) {
  a.state.heard({.member = "b", .boot = "boot-b", .role = "standby"}, at(10));
  a.state.heard({.member = "b", .boot = "boot-b", .role = "offline"}, at(20));
  EXPECT_EQ(a.peers.peer(), "");
  a.state.heard({.member = "b", .boot = "boot-b", .role = "standby"}, at(30));
  EXPECT_EQ(a.peers.peer(), "b");
}

TEST_F(PairStateTest, StatusNamesThePeerUntilItHasEnded) {
  a.state.heard({.member = "b", .boot = "boot-b", .role = "standby"}, at(10));
  EXPECT_TRUE(a.steps(10, Action::publish_status));
  a.state.heard({.member = "b", .boot = "boot-b", .role = "offline"}, at(20));
  EXPECT_TRUE(a.steps(20, Action::publish_status));
  a.state.heard({.member = "b", .boot = "boot-b", .role = "offline"}, at(30));
  EXPECT_FALSE(a.steps(30, Action::publish_status)) << "nothing has changed";
}

TEST(PairState, PeerThatIsThereHasTimeToAnswer) {
  Gateway a;
  EXPECT_FALSE(a.peers.has_listened(at(5000)));
  a.peers.joined(at(0));
  EXPECT_FALSE(a.peers.has_listened(at(1199)));
  EXPECT_TRUE(a.peers.has_listened(at(1200)));
  a.peers.left(false);
  EXPECT_FALSE(a.peers.has_listened(at(5000)))
      << "its own session has ended, not that of the other";
}

TEST(PairState, GatewayAloneClaimsAfterHalfTheSilence) {
  Gateway a;
  EXPECT_FALSE(a.steps(0, Action::connect_lease)) << "it has not joined";
  a.peers.joined(at(0));
  EXPECT_FALSE(a.steps(599, Action::connect_lease));
  EXPECT_EQ(a.state.next_wake(), at(600));
  EXPECT_TRUE(a.steps(600, Action::connect_lease));
  EXPECT_FALSE(a.steps(601, Action::connect_lease)) << "once";
}

TEST_F(PairStateTest, FirstRequestComesAfterTheSilence) {
  a.claim(1000);
  EXPECT_EQ(a.state.role(), PairRole::claiming);
  EXPECT_EQ(a.state.opens_at(), at(2200));
  a.beat(2199);
  a.state.step(at(2199));
  EXPECT_EQ(a.state.role(), PairRole::claiming);
  a.state.step(at(2200));
  EXPECT_EQ(a.state.role(), PairRole::active);
}

TEST_F(PairStateTest, PermissionCountsFromTheSendingOfAHeartbeatAndNotFromItsAcknowledgement) {
  a.claim(1000);
  EXPECT_EQ(a.state.holds_until(), at(1600));
  a.state.heartbeat_sent(7, at(1200));
  EXPECT_EQ(a.state.holds_until(), at(1600));
  a.state.heartbeat_acknowledged(7);  // the process was stopped for a minute
  EXPECT_EQ(a.state.holds_until(), at(1800));
}

TEST_F(PairStateTest, OnlyAHeartbeatAfterTheClaimPermitsRequests) {
  a.claim(0);
  a.state.heartbeat_sent(++a.id, at(1000));
  a.state.has_claimed(at(1000));
  EXPECT_EQ(a.state.holds_until(), BootTime{});
  a.state.heartbeat_acknowledged(a.id);  // sent before, without a number of this gateway
  EXPECT_EQ(a.state.holds_until(), BootTime{});
  a.beat(1100);
  EXPECT_EQ(a.state.holds_until(), at(1100) + kQuiet / 2);
}

TEST_F(PairStateTest, LongClaimKeepsItsLease) {
  a.claim(0);
  for (int ms = 200; ms <= 2400; ms += 200) a.beat(ms);
  a.state.has_claimed(at(2400));
  EXPECT_FALSE(a.steps(4799, Action::drop_lease)) << "the broker has 2400 ms to answer again";
  EXPECT_TRUE(a.steps(4800, Action::drop_lease));
}

TEST(PairState, LongerSettingOfTheOtherCountsAndIsNamed) {
  JoinedGateway b("b", "boot-b");
  b.state.heard({"a", "boot-a", "active", false, 2 * kQuiet}, at(0));
  EXPECT_EQ(b.peers.take_fault().text,
            "quiet_ms of member a is 2400, and of member b 1200: make them equal; until then both "
            "wait for the longer one");
  b.peers.heard_heartbeat("a", "boot-a", 5, at(0));
  // Half of 2400 ms, and a quarter more after the start, because its name is the higher one.
  EXPECT_FALSE(b.steps(1799, Action::connect_lease));
  EXPECT_TRUE(b.steps(1800, Action::connect_lease));
  b.claim(1800);
  EXPECT_EQ(b.state.opens_at(), at(1800 + 2400)) << "member a may send for 1200 ms";
  EXPECT_EQ(b.state.holds_until(), at(1800 + 600));
}

TEST(PairState, SettingOfAGatewayThatHasEndedCounts) {
  JoinedGateway b("b", "boot-b");
  b.state.heard({"a", "boot-a", "offline", false, 2 * kQuiet}, at(0));
  EXPECT_EQ(b.peers.take_fault().text, "") << "its file may be right by now";
  b.claim(1300);
  EXPECT_EQ(b.state.opens_at(), at(1300 + 2400));
}

TEST(PairState, StandbyWaitsWhileTheHolderIsHeard) {
  JoinedGateway b("b", "boot-b");
  for (int ms = 0; ms < 5000; ms += 200) {
    b.peers.heard_heartbeat("a", "boot-a", 5, at(ms));
    EXPECT_FALSE(b.steps(ms + 199, Action::connect_lease)) << ms;
  }
  EXPECT_TRUE(b.steps(4800 + 600, Action::connect_lease));
  EXPECT_EQ(b.peers.highest_seq(), 5U);
}

TEST(PairState, StandbyClaimsAtOnceWhenTheHolderHasEnded) {
  JoinedGateway b("b", "boot-b");
  b.state.heard({"a", "boot-a", "active"}, at(0));
  b.peers.heard_heartbeat("a", "boot-a", 0, at(5000));
  b.state.heard({"a", "boot-a", "offline"}, at(5010));
  EXPECT_TRUE(b.steps(5010, Action::connect_lease));
  b.state.lease_ended(false, at(5020));
  b.peers.heard_heartbeat("a", "boot-a", 0, at(5021));  // was on its way
  EXPECT_TRUE(b.steps(5620, Action::connect_lease)) << "a boot that has ended holds nothing";
}

TEST_F(PairStateTest, LoserIsStandbyAndDoesNotThrash) {
  a.claim(1000);
  a.beat(2200);
  a.state.step(at(2200));
  ASSERT_EQ(a.state.role(), PairRole::active);
  a.state.lease_ended(true, at(2300));
  EXPECT_EQ(a.state.role(), PairRole::standby);
  EXPECT_EQ(a.state.holds_until(), BootTime{});
  EXPECT_EQ(a.state.why(), "the other gateway has claimed the pair");
  EXPECT_FALSE(a.steps(3499, Action::connect_lease));
  a.state.heartbeat_acknowledged(a.id);
  EXPECT_EQ(a.state.holds_until(), BootTime{}) << "a late acknowledgement permits nothing";
}

TEST_F(PairStateTest, BrokerThatAcknowledgesNothingIsLeft) {
  a.claim(1000);
  a.beat(2200);
  EXPECT_FALSE(a.steps(2800 + 2399, Action::drop_lease));
  EXPECT_TRUE(a.steps(2800 + 2400, Action::drop_lease));
  EXPECT_FALSE(a.steps(2800 + 2401, Action::drop_lease)) << "once";
}

TEST_F(PairStateTest, FailedClaimsGrowApart) {
  ASSERT_TRUE(a.steps(600, Action::connect_lease));
  int now = 600;
  for (const int wait : {600, 1200, 2400, 4800, 9600, 9600}) {
    a.state.lease_ended(false, at(now));
    EXPECT_FALSE(a.steps(now + wait - 1, Action::connect_lease)) << wait;
    EXPECT_TRUE(a.steps(now + wait, Action::connect_lease)) << wait;
    now += wait;
  }
}

TEST_F(PairStateTest, WithoutItsMemberSessionAGatewayClaimsNothing) {
  a.peers.left(false);
  EXPECT_FALSE(a.steps(100000, Action::connect_lease));
  EXPECT_EQ(a.peers.take_fault().text, "");
}

TEST(PairState, LowerNameClaimsFirstIfBothStart) {
  Gateway a("a", "boot-a");
  Gateway b("b", "boot-b");
  for (Gateway* each : {&a, &b}) each->peers.joined(at(0));
  a.state.heard({"b", "boot-b", "standby"}, at(1));
  b.state.heard({"a", "boot-a", "standby"}, at(1));
  EXPECT_TRUE(a.steps(600, Action::connect_lease));
  EXPECT_FALSE(b.steps(600, Action::connect_lease));
  EXPECT_TRUE(b.steps(900, Action::connect_lease)) << "if the other one does not";
}

TEST(PairState, ThirdGatewayIsNamedAndNeverClaims) {
  JoinedGateway c("c", "boot-c");
  c.state.heard({"a", "boot-a", "active"}, at(1));
  c.state.heard({"b", "boot-b", "standby"}, at(2));
  EXPECT_TRUE(c.peers.is_third());
  EXPECT_NE(c.peers.take_fault().text.find("a, b"), std::string::npos);
  EXPECT_EQ(c.peers.take_fault().text, "") << "once";
  EXPECT_FALSE(c.steps(60000, Action::connect_lease));
  c.state.heard({"a", "boot-a", "offline"}, at(60001));
  EXPECT_FALSE(c.peers.is_third()) << "it is the second now";
  EXPECT_FALSE(c.steps(61100, Action::connect_lease)) << "the other one of the pair goes first";
}

TEST(PairState, MembersOfAPairStayWhatTheyAreWhenAThirdOneComes) {
  JoinedGateway b("b", "boot-b");
  b.state.heard({"a", "boot-a", "active"}, at(1));
  b.state.heard({"b", "boot-b", "standby"}, at(2));  // its own, which it published when it joined
  b.peers.heard_heartbeat("a", "boot-a", 0, at(9990));
  b.state.heard({"0", "boot-0", "standby"}, at(10000));
  EXPECT_FALSE(b.peers.is_third());
  EXPECT_NE(b.peers.take_fault().text.find("0, a"), std::string::npos);
  b.state.heard({"0", "boot-0", "standby", true}, at(10001));
  b.state.heard({"a", "boot-a", "offline"}, at(10002));
  EXPECT_TRUE(b.steps(10002, Action::connect_lease));
}

TEST(PairState, TwoGatewaysOfOneNameAreNamed) {
  JoinedGateway a("a", "boot-1");
  a.state.heard({"a", "boot-0", "active"}, at(1));
  EXPECT_EQ(a.peers.take_fault().text, "") << "an earlier process may have left it";
  a.state.heard({"a", "boot-1", "standby"}, at(2));
  a.state.heard({"a", "boot-2", "standby"}, at(3));
  a.state.step(at(3));
  EXPECT_NE(a.peers.take_fault().text.find("pair.member"), std::string::npos);
  JoinedGateway other("a", "boot-2");
  other.peers.left(true);
  other.state.step(at(3));
  EXPECT_NE(other.peers.take_fault().text.find("pair.member"), std::string::npos);
}

TEST(PairState, FaultsAreNamedWhenTheyAreOver) {
  const auto expect_over = [](Gateway& gateway, const std::string& words) {
    const PairFault fault = gateway.peers.take_fault();
    EXPECT_TRUE(fault.is_over && fault.text.find(words) != std::string::npos) << fault.text;
    EXPECT_EQ(gateway.peers.take_fault().text, "");
  };
  JoinedGateway b("b", "boot-b");
  b.state.heard({"a", "boot-1", "active", false, 2 * kQuiet}, at(1));
  EXPECT_FALSE(b.peers.take_fault().is_over);
  b.state.heard({"a", "boot-1", "offline", false, 2 * kQuiet}, at(2));
  EXPECT_EQ(b.peers.take_fault().text, "") << "its file may still be wrong";
  b.state.heard({"a", "boot-2", "standby", false, kQuiet}, at(3));
  expect_over(b, "quiet_ms of member a is 2400");

  b.state.heard({"c", "boot-c", "standby"}, at(4));
  EXPECT_NE(b.peers.take_fault().text.find("a, c"), std::string::npos);
  b.peers.left(false);
  b.peers.joined(at(10000));
  b.state.step(at(10001));
  EXPECT_EQ(b.peers.take_fault().text, "") << "their statuses may still come";
  b.state.heard({"a", "boot-2", "active", false, kQuiet}, at(10002));
  b.state.step(at(13000));
  expect_over(b, "a pair has two gateways");

  b.peers.left(true);
  b.peers.joined(at(20000));
  b.state.step(at(20000));
  EXPECT_NE(b.peers.take_fault().text.find("pair.member"), std::string::npos);
  b.state.step(at(199999));
  EXPECT_EQ(b.peers.take_fault().text, "");
  b.peers.left(false);  // the other one may be away as well
  b.peers.joined(at(300000));
  b.state.step(at(479999));
  EXPECT_EQ(b.peers.take_fault().text, "");
  b.state.step(at(480000));
  expect_over(b, "pair.member");
}

TEST(PairState, FaultsThatComeAndGoAreAlwaysNamed) {
  JoinedGateway b("b", "boot-b");
  for (int i = 0; i < 1000; ++i) {
    b.state.heard({"a", "boot-1", "active", false, 2 * kQuiet}, at(2 * i));
    EXPECT_FALSE(b.peers.take_fault().text.empty()) << i;
    b.state.heard({"a", "boot-1", "active", false, kQuiet}, at(2 * i + 1));
    EXPECT_TRUE(b.peers.take_fault().is_over) << i;
  }
}

TEST_F(PairStateTest, KnowsTheBootsOfThePair) {
  a.state.heard({"b", "boot-b", "offline"}, at(1));
  a.peers.heard_heartbeat("a", "boot-old", 0, at(1));
  EXPECT_TRUE(a.peers.knows("boot-b"));
  EXPECT_TRUE(a.peers.knows("boot-old"));
  EXPECT_FALSE(a.peers.knows("boot-a"));
  EXPECT_FALSE(a.peers.knows("boot-x"));
}

TEST(PairPeers, TheHighestNumberTellsWhichGatewayHeldThePairLast) {
  JoinedGateway a;
  EXPECT_FALSE(a.peers.other_held_last());
  a.peers.heard_heartbeat("b", "boot-b", 5, at(1));
  EXPECT_TRUE(a.peers.other_held_last());
  a.peers.heard_heartbeat("a", "boot-old", 7, at(2));
  EXPECT_FALSE(a.peers.other_held_last());
  a.peers.heard_heartbeat("a", "boot-a", 9, at(3));  // of this process
  a.peers.heard_heartbeat("b", "boot-b", 8, at(4));
  EXPECT_TRUE(a.peers.other_held_last());
}

/// A broker for two gateways: delivers what they publish after a random time, ends the lease
/// session of the one when the other claims, and cuts, stops and ends them at random.
class RandomPair final {
 public:
  explicit RandomPair(unsigned seed) : random_(seed) {}

  void run(int until_ms) {
    for (now_ = 0; now_ < until_ms; ++now_) {
      if (chance(2000)) disturb();
      for (Member& each : members_) step(each);
      check();
    }
  }
  int changes() const { return changes_; }

 private:
  struct Member {
    explicit Member(std::string member) : name(std::move(member)) { begin(); }
    void begin() {
      gateway.emplace(name, name + std::to_string(++boots));
      joined = lease = false;
    }
    bool may_send(int now) const {
      const PairState& state = gateway->state;
      return at(now) >= state.opens_at() && at(now) < state.holds_until();
    }
    const std::string name;
    int boots = 0;
    std::optional<Gateway> gateway;
    bool joined = false;
    bool lease = false;        ///< as the broker sees it
    bool lease_known = false;  ///< as the gateway sees it
    int stopped_until = 0;
    int cut_until = 0;
    std::vector<std::pair<int, std::uint64_t>> acknowledgements;
  };

  bool chance(int of) { return std::uniform_int_distribution(0, of - 1)(random_) == 0; }
  int delay() { return std::uniform_int_distribution(0, 40)(random_); }
  Member& other(const Member& of) { return &of == &members_[0] ? members_[1] : members_[0]; }
  std::string boot(const Member& of) const { return of.name + std::to_string(of.boots); }

  void disturb() {
    Member& member = members_[chance(2) ? 0 : 1];
    if (chance(3)) member.stopped_until = now_ + std::uniform_int_distribution(1, 5000)(random_);
    if (chance(3)) member.cut_until = now_ + std::uniform_int_distribution(1, 5000)(random_);
    if (!chance(3)) return;
    other(member).gateway->state.heard({member.name, boot(member), "offline"}, at(now_));
    member.begin();
    member.lease_known = false;
    member.acknowledgements.clear();
  }

  void step(Member& member) {
    if (now_ < member.stopped_until) return;
    PairState& state = member.gateway->state;
    const bool cut = now_ < member.cut_until;
    if (cut && member.joined) {
      member.joined = false;
      member.gateway->peers.left(false);
      if (member.lease_known) state.lease_ended(false, at(now_));
      member.lease = member.lease_known = false;
    }
    if (!cut && !member.joined) {
      member.joined = true;
      member.gateway->peers.joined(at(now_));
    }
    if (member.lease_known && !member.lease) {
      member.lease_known = false;
      state.lease_ended(true, at(now_));
    }
    std::erase_if(member.acknowledgements, [&](const auto& each) {
      if (each.first > now_) return false;
      if (member.lease_known) state.heartbeat_acknowledged(each.second);
      return true;
    });
    for (const Action action : state.step(at(now_))) {
      if (action == Action::connect_lease && cut) state.lease_ended(false, at(now_));
      if (action == Action::connect_lease && !cut) {
        other(member).lease = false;
        member.lease = member.lease_known = true;
        member.acknowledgements.clear();
        state.lease_began(at(now_));
        state.agent_began();
        ++changes_;
      }
      if (action == Action::send_heartbeat) {
        const std::uint64_t id = ++ids_;
        state.heartbeat_sent(id, at(now_));
        if (!member.lease || cut) continue;
        member.acknowledgements.emplace_back(now_ + delay(), id);
        if (other(member).joined)
          other(member).gateway->peers.heard_heartbeat(member.name, boot(member), 0, at(now_));
      }
    }
  }

  /// A gateway that is stopped sends nothing; one that runs asks before each request.
  void check() {
    for (std::size_t i = 0; i < members_.size(); ++i) {
      if (now_ < members_[i].stopped_until || !members_[i].may_send(now_)) continue;
      if (last_master_ != i) {
        ASSERT_GE(now_ - last_active_, kQuiet.count() / 2) << "at " << now_;
      }
      last_master_ = i;
      last_active_ = now_;
    }
  }

  std::mt19937 random_;
  std::array<Member, 2> members_{Member("a"), Member("b")};
  int now_ = 0;
  int changes_ = 0;
  std::uint64_t ids_ = 0;
  std::size_t last_master_ = 2;
  int last_active_ = -100000;
};

TEST(PairState, RandomPairNeverHasTwoMastersAndAlwaysGetsOneAgain) {
  int changes = 0;
  for (unsigned seed = 1; seed <= 20; ++seed) {
    SCOPED_TRACE(seed);
    RandomPair pair(seed);
    pair.run(60000);
    if (HasFatalFailure()) return;
    changes += pair.changes();
  }
  EXPECT_GT(changes, 40);
}

}  // namespace
}  // namespace fxagent
