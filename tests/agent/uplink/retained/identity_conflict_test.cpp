#include "agent/uplink/retained/identity_conflict.h"

#include <gtest/gtest.h>

namespace fxagent {
namespace {

using namespace std::chrono_literals;

const std::string kOwn = R"({"state":"online","boot":"mine"})";
const std::string kOther = R"({"state":"online","boot":"0ther"})";
const SteadyTime kNow{};

struct ConnectedAgent {
  ConnectedAgent() { conflict.connection_began("mqtt://a", kNow, 60s); }
  bool unheard_at(SteadyTime::duration after, bool held = false) {
    return conflict.keep(kNow + after, held);
  }
  IdentityConflict conflict{"mine"};
};

TEST(IdentityConflict, OwnStateThatDoesNotComeBackIsToldOnce) {
  ConnectedAgent a;
  EXPECT_EQ(a.conflict.next_wake(), kNow + 30s);
  EXPECT_FALSE(a.unheard_at(29s));
  EXPECT_TRUE(a.unheard_at(30s));
  EXPECT_FALSE(a.unheard_at(31s));
  EXPECT_EQ(a.conflict.next_wake(), SteadyTime::max());
  a.conflict.connection_began("mqtt://a", kNow + 40s, 60s);
  EXPECT_FALSE(a.unheard_at(70s)) << "it is known";
  a.conflict.heard(kOwn, kNow + 71s);
  a.conflict.connection_began("mqtt://a", kNow + 80s, 60s);
  EXPECT_TRUE(a.unheard_at(110s)) << "it had come back, and does not any more";
}

TEST(IdentityConflict, OwnStateThatComesBackIsNoNews) {
  ConnectedAgent a;
  a.conflict.heard(kOther, kNow + 1s);
  a.conflict.heard(kOwn, kNow + 2s);
  EXPECT_FALSE(a.unheard_at(60s));
}

TEST(IdentityConflict, OwnStateMayWaitBehindWhatIsNotLetIn) {
  ConnectedAgent a;
  EXPECT_FALSE(a.unheard_at(29s, true));
  EXPECT_FALSE(a.unheard_at(33s));
  EXPECT_TRUE(a.unheard_at(34s));
}

TEST(IdentityConflict, SixteenOtherAgentsAreEnough) {
  ConnectedAgent a;
  const auto say = [&](int number, const std::string& state) {
    a.conflict.heard(R"({"state":")" + state + R"(","boot":"b)" + std::to_string(number) + R"("})",
                     kNow);
  };
  for (int other = 100; other < 140; ++other) say(other, "online");
  for (int other = 124; other < 140; ++other) {
    EXPECT_TRUE(a.conflict.other());
    say(other, "offline");
  }
  EXPECT_FALSE(a.conflict.other()) << "the ones before are forgotten";
}

TEST(IdentityConflict, LongStateIsNotRead) {
  for (const std::size_t length : {3000U, 5000U}) {
    ConnectedAgent a;
    a.conflict.heard(
        R"({"state":"online","boot":"0ther","more":")" + std::string(length, 'x') + R"("})", kNow);
    EXPECT_EQ(a.conflict.other().has_value(), length == 3000U);
  }
}

TEST(IdentityConflict, WithoutAConnectionNothingIsMissed) {
  ConnectedAgent a;
  a.conflict.connection_ended();
  EXPECT_FALSE(a.unheard_at(60s));
}

}  // namespace
}  // namespace fxagent
