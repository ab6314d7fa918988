#include "agent/remote/remote_report.h"
#include "agent/config/config_error.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace fxagent {
namespace {

using nlohmann::json;
using State = RemoteReport::State;

json reported(const ConfigErrors& errors) {
  return json::parse(reported_text(make_report(State::rejected, {}, errors, 7), "h", "", true));
}

TEST(RemoteReport, OneLongErrorIsCutBetweenCharactersAndSaid) {
  std::string text = "x";
  while (text.size() < 100'000) text += "ü";
  const json report = reported({{"/devices", 0, text}});
  ASSERT_EQ(report["errors"].size(), 1u);
  const std::string said = report["errors"][0];
  EXPECT_EQ(said.rfind("/devices: xü", 0), 0u);
  EXPECT_LT(said.size(), kMostErrorBytes + 8);
  EXPECT_EQ(said.find("\xEF\xBF\xBD"), std::string::npos);
  EXPECT_EQ(report["errors_in_all"], 1);
}

TEST(RemoteReport, WhatIsEscapedCountsAsItIsSent) {
  const ConfigErrors errors(3000, ConfigError{std::string(2000, '\1'), 0, "is wrong"});
  const RemoteReport report = make_report(State::rejected, {}, errors, 7);
  const std::string text = reported_text(report, "h", "", true);
  EXPECT_LT(text.size(), kMostReportedBytes + 1024);
  EXPECT_GT(report.errors.size(), 1u);
  EXPECT_EQ(json::parse(text)["errors_in_all"], 3000);
}

TEST(RemoteReport, MoreErrorsThatAreNotShownAreNewsToo) {
  const auto of = [](std::size_t count) {
    return make_report(State::rejected, {}, ConfigErrors(count, {"/a", 0, "b"}), 7);
  };
  EXPECT_TRUE(of(3000).says(of(3000)));
  EXPECT_FALSE(of(3000).says(of(3001)));
}

}  // namespace
}  // namespace fxagent
