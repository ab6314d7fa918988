#include "protocol/plan/cheapest_reads.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/support/pick.h"

namespace fxagent {
namespace {

ReadWay gathered() { return {.gather = 1}; }

TEST(Forbidden, WhatIsKnownOfAnotherSpaceForbidsNothing) {
  Holes holes;
  holes.cuts.push_back({7, 32});
  holes.missing.push_back({7, 32, 16});
  holes.never_gathered.push_back({7, 32, 16});
  EXPECT_FALSE(Forbidden(holes, 6).forbids(gathered(), {0, 640}));
  EXPECT_TRUE(Forbidden(holes, 7).forbids(gathered(), {0, 640}));
}

TEST(Forbidden, NoReadCrossesABorderOfItsSpace) {
  const Forbidden forbidden({}, 0, {48, 16});
  EXPECT_FALSE(forbidden.forbids({}, {0, 16}));
  EXPECT_FALSE(forbidden.forbids({}, {16, 48}));
  EXPECT_TRUE(forbidden.forbids({}, {15, 17}));
  EXPECT_TRUE(forbidden.forbids({}, {32, 64}));
}

TEST(Forbidden, SaysOfAnyReadWhatOneLookAtAllHolesWouldSay) {
  test::Pick pick(500);
  std::size_t allowed = 0;
  std::size_t held = 0;
  std::size_t apart = 0;
  for (int round = 0; round < 2000; ++round) {
    Holes holes;
    for (std::uint32_t n = pick(0, 5); n > 0; --n) holes.cuts.push_back({0, pick(0, 60)});
    for (std::uint32_t n = pick(0, 5); n > 0; --n)
      holes.missing.push_back({0, pick(0, 60), pick(1, 20)});
    for (std::uint32_t n = pick(0, 5); n > 0; --n)
      holes.never_gathered.push_back({0, pick(0, 60), pick(1, 20)});
    const Forbidden forbidden(holes, 0);
    for (int i = 0; i < 20; ++i) {
      const Span read{0, pick(0, 60), pick(1, 30)};
      const bool is_held = std::any_of(holes.cuts.begin(), holes.cuts.end(),
                                       [&](const Holes::Cut& cut) {
                                         return read.first_bit < cut.at && cut.at < read.end_bit();
                                       }) ||
                           std::any_of(holes.missing.begin(), holes.missing.end(),
                                       [&](const Span& hole) { return read.contains(hole); });
      const bool is_apart = std::any_of(holes.never_gathered.begin(), holes.never_gathered.end(),
                                        [&](const Span& place) { return overlap(place, read); });
      const Extent extent{read.first_bit, read.end_bit()};
      ASSERT_EQ(forbidden.forbids(ReadWay{}, extent), is_held) << round;
      ASSERT_EQ(forbidden.forbids(gathered(), extent), is_held || is_apart) << round;
      (is_held ? held : is_apart ? apart : allowed) += 1;
    }
  }
  EXPECT_GT(std::min({allowed, held, apart}), 1000U);
}

}  // namespace
}  // namespace fxagent
