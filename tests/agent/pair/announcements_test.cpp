#include "agent/pair/announcements.h"

#include <gtest/gtest.h>

#include <chrono>

#include "agent/pair/pair_messages.h"

namespace fxagent {
namespace {

using namespace std::chrono_literals;
using Texts = std::vector<std::string>;

struct AnnouncementsTest : ::testing::Test {
  void add(const std::string& id, SteadyTime::duration allowed = 10s, std::uint32_t device = 0) {
    AdmittedCommand command;
    command.command.id = id;
    command.command.device = device;
    command.deadline = now + allowed;
    announcements.add(std::move(command), "press1",
                      [this](AdmittedCommand c) { submitted.push_back(c.command.id); });
  }
  void step(std::size_t window = 8) {
    announcements.step(
        window,
        [this](const std::string& text) {
          const auto announcement = pair_messages::announcement_from(text);
          published.push_back("announces " + announcement.value().entry.id);
          return published.size();
        },
        now);
  }

  SteadyTime now{1h};
  int wakes = 0;
  Announcements announcements{"boot", [this] { ++wakes; }};
  Texts published;  ///< with the ids 1, 2, ...
  Texts submitted;
};

TEST_F(AnnouncementsTest, CommandIsSubmittedWhenTheBrokerHasItsAnnouncement) {
  add("a");
  add("b");
  step();
  EXPECT_EQ(published, (Texts{"announces a", "announces b"}));
  EXPECT_EQ(submitted, Texts{});
  EXPECT_TRUE(announcements.delivered(2));
  EXPECT_FALSE(announcements.delivered(2));
  EXPECT_FALSE(announcements.delivered(3)) << "that is no announcement";
  EXPECT_EQ(submitted, Texts{"b"});
  EXPECT_TRUE(announcements.delivered(1));
  EXPECT_EQ(submitted, (Texts{"b", "a"}));
}

TEST_F(AnnouncementsTest, ReadNeedsNoAnnouncement) {
  AdmittedCommand command;
  command.command.op = Op::read;
  command.command.id = "r";
  announcements.add(std::move(command), "press1",
                    [this](AdmittedCommand c) { submitted.push_back(c.command.id); });
  EXPECT_EQ(submitted, Texts{"r"});
  step();
  EXPECT_EQ(published, Texts{});
}

TEST_F(AnnouncementsTest, WhatMustNotWaitWakesThePairsThread) {
  add("a");
  EXPECT_EQ(wakes, 1);
  announcements.take_back({0}, [](const std::vector<AdmittedCommand>&) {});
  EXPECT_EQ(wakes, 2);
  announcements.release();
  EXPECT_EQ(wakes, 3);
}

TEST_F(AnnouncementsTest, NothingIsAnnouncedWithoutTheLease) {
  add("a");
  step(0);
  EXPECT_EQ(published, Texts{});
  step();
  EXPECT_EQ(published, Texts{"announces a"});
}

TEST_F(AnnouncementsTest, BurstKeepsWithinTheWindow) {
  for (const char* id : {"a", "b", "c", "d"}) add(id);
  step(2);
  EXPECT_EQ(published, (Texts{"announces a", "announces b"}));
  step(2);
  EXPECT_EQ(published.size(), 2U);
  EXPECT_TRUE(announcements.delivered(2));
  step(2);
  EXPECT_EQ(published.back(), "announces c");
  announcements.refused(1);
  step(2);
  EXPECT_EQ(published.size(), 4U) << "a refused one is not on its way";
}

TEST_F(AnnouncementsTest, CommandThatTheBrokerRefusesIsSubmittedAfterItsDeadline) {
  add("a", 5s);
  step();
  announcements.refused(1);
  announcements.refused(7);  // no announcement
  now += 5s;
  step();
  EXPECT_EQ(submitted, Texts{});
  now += 1ms;
  step();
  EXPECT_EQ(submitted, Texts{"a"});
}

TEST_F(AnnouncementsTest, WhatIsTakenBackIsNeverSubmitted) {
  add("refused");
  add("on the way");
  add("of another device", 10s, 1);
  step();
  announcements.refused(1);
  add("added");
  Texts taken;
  announcements.take_back({0, 2}, [&](const std::vector<AdmittedCommand>& waiting) {
    for (const AdmittedCommand& each : waiting) taken.push_back(each.command.id);
  });
  EXPECT_EQ(taken, Texts{}) << "that is for the pair's thread";
  step(0);
  EXPECT_EQ(taken, (Texts{"refused", "on the way", "added"}));
  EXPECT_FALSE(announcements.delivered(2));
  now += 1h;
  step();
  EXPECT_EQ(published.size(), 3U);
  EXPECT_EQ(submitted, Texts{});
  EXPECT_TRUE(announcements.delivered(3));
  EXPECT_EQ(submitted, Texts{"of another device"});
}

TEST_F(AnnouncementsTest, ReleaseSubmitsAllThatWaitsAndLaterCommandsAtOnce) {
  add("refused");
  add("on the way");
  step();
  announcements.refused(1);
  add("added");
  announcements.release();
  EXPECT_EQ(submitted, Texts{});
  add("later");
  EXPECT_EQ(submitted, Texts{"later"});
  step(0);
  EXPECT_EQ(submitted, (Texts{"later", "refused", "on the way", "added"}));
  EXPECT_FALSE(announcements.delivered(2));
  EXPECT_EQ(published.size(), 2U);
}

}  // namespace
}  // namespace fxagent
