// The Prometheus page, compared with the text format and the table of docs/interface.md.
#include "agent/http/exposition.h"

#include <gtest/gtest.h>

#include <fstream>
#include <regex>

#include "tests/agent/http/made_up_status.h"

namespace fxagent {
namespace {

using namespace test;
using namespace std::chrono_literals;

std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream in(text);
  for (std::string line; std::getline(in, line);) lines.push_back(line);
  return lines;
}

/// Returns the value of `series` as text; "" if the series is missing or appears twice.
std::string value_of(const std::string& text, const std::string& series) {
  std::string value;
  for (const std::string& line : lines_of(text)) {
    if (!line.starts_with(series + " ")) continue;
    if (!value.empty()) return {};
    value = line.substr(series.size() + 1);
  }
  return value;
}

const std::string& page() {
  static const std::string text = exposition(made_up_status());
  return text;
}

TEST(Exposition, EachNumberOfTheStatusIsInIt) {
  const std::map<std::string, std::string> expected{
      {R"(fxagent_build_info{agent="edge7",version="0.1.0"})", "1"},
      {"fxagent_uptime_seconds", "60"},
      {"process_resident_memory_bytes", "10485760"},
      {"fxagent_clock_synchronised", "1"},
      {"fxagent_identity_conflict", "0"},
      {"fxagent_broker_connected", "1"},
      {"fxagent_broker_subscribed", "1"},
      {"fxagent_samples_collected_total", "4821"},
      {"fxagent_samples_recovered_total", "17"},
      {"fxagent_samples_suppressed_total", "4100"},
      {"fxagent_samples_acknowledged_total", "732"},
      {"fxagent_samples_dropped_total", "0"},
      {"fxagent_samples_published_total", "738"},
      {R"(fxagent_profile_connected{profile="plain@cloud"})", "1"},
      {R"(fxagent_profile_ready{profile="plain@cloud"})", "1"},
      {R"(fxagent_profile_samples_acknowledged_total{profile="plain@cloud"})", "684"},
      {R"(fxagent_profile_samples_dropped_total{profile="plain@cloud"})", "1"},
      {R"(fxagent_profile_samples_waiting{profile="plain@cloud"})", "15"},
      {R"(fxagent_samples_waiting{place="queued"})", "1"},
      {R"(fxagent_samples_waiting{place="in_flight"})", "2"},
      {R"(fxagent_samples_waiting{place="stored"})", "3"},
      {"fxagent_samples_balanced", "1"},
      {"fxagent_store_on_disk", "1"},
      {"fxagent_store_bytes", "40960"},
      {"fxagent_store_left_seconds", "2925000"},
      {"fxagent_audit_records", "54"},
      {R"(fxagent_commands_total{status="SUCCEEDED"})", "12"},
      {R"(fxagent_commands_total{status="FAILED"})", "0"},
      {R"(fxagent_commands_total{status="UNKNOWN_OUTCOME"})", "1"},
      {"fxagent_command_duration_seconds_count", "1"},
      {"fxagent_command_duration_seconds_sum", "0.062"},
      {R"(fxagent_link_open{link="line1"})", "1"},
      {R"(fxagent_exchanges_total{link="line1"})", "9642"},
      {R"(fxagent_timeouts_total{link="line1"})", "3"},
      {R"(fxagent_naks_total{link="line1"})", "4"},
      {R"(fxagent_bad_frames_total{link="line1"})", "5"},
      {R"(fxagent_unexpected_bytes_total{link="line1"})", "6"},
      {R"(fxagent_line_doubts_total{link="line1"})", "7"},
      {R"(fxagent_line_doubted{link="line1"})", "0"},
      {R"(fxagent_line_busy_ratio{link="line1"})", "0.825"},
      {R"(fxagent_line_load_ratio{link="line1"})", "1.25"},
      {R"(fxagent_device_up{device="press1",link="line1"})", "1"},
      {R"(fxagent_device_up{device="press2",link="line1"})", "0"},
      {R"(fxagent_device_degraded{device="press2",link="line1"})", "0"},
      {R"(fxagent_device_other_model{device="press1",link="line1"})", "0"},
      {R"(fxagent_polls_total{device="press1",link="line1"})", "4821"},
      {R"(fxagent_missed_polls_total{device="press1",link="line1"})", "8"},
      {R"(fxagent_device_samples_dropped_total{device="press2",link="line1"})", "12"},
      {R"(fxagent_device_samples_refused{device="press1",link="line1"})", "0"},
      {R"(fxagent_device_samples_refused{device="press2",link="line1"})", "1"}};
  for (const auto& [series, value] : expected) EXPECT_EQ(value_of(page(), series), value) << series;
}

TEST(Exposition, ADegradedDeviceIsUp) {
  AgentStatus status = made_up_status();
  DeviceStatus degraded;
  degraded.state = DeviceStatus::State::degraded;
  status.devices[0] = std::make_shared<const DeviceStatus>(degraded);
  const std::string text = exposition(status);
  EXPECT_EQ(value_of(text, R"(fxagent_device_up{device="press1",link="line1"})"), "1");
  EXPECT_EQ(value_of(text, R"(fxagent_device_degraded{device="press1",link="line1"})"), "1");
}

TEST(Exposition, ADeviceOfAnotherModelThanConfiguredIsMarked) {
  AgentStatus status = made_up_status();
  DeviceStatus other = *status.devices[0];
  other.model_configured = "FX5U";
  status.devices[0] = std::make_shared<const DeviceStatus>(other);
  EXPECT_EQ(
      value_of(exposition(status), R"(fxagent_device_other_model{device="press1",link="line1"})"),
      "1");
}

TEST(Exposition, BucketsOfAHistogramAreCumulative) {
  const std::string name = "fxagent_exchange_turnaround_seconds";
  const auto bucket = [&](const std::string& bound) {
    return value_of(page(), name + R"(_bucket{link="line1",le=")" + bound + R"("})");
  };
  EXPECT_EQ(bucket("0.001"), "1");
  EXPECT_EQ(bucket("0.0025"), "2");
  EXPECT_EQ(bucket("0.025"), "2");
  EXPECT_EQ(bucket("0.05"), "4");
  EXPECT_EQ(bucket("10"), "4");
  EXPECT_EQ(bucket("+Inf"), "4");
  EXPECT_EQ(value_of(page(), name + R"(_count{link="line1"})"), "4");
  EXPECT_EQ(value_of(page(), name + R"(_sum{link="line1"})"), "0.063");
  const std::string late = "fxagent_poll_lateness_seconds_bucket{link=\"line1\",le=";
  EXPECT_EQ(value_of(page(), late + "\"10\"}"), "1");
  EXPECT_EQ(value_of(page(), late + "\"+Inf\"}"), "2");
}

TEST(Exposition, WhatIsNotKnownYetIsLeftOut) {
  AgentStatus status;
  status.config = std::make_shared<const Config>(plant());
  status.devices = {nullptr, nullptr};
  const std::string text = exposition(status);
  for (const std::string name :
       {"fxagent_exchanges_total", "fxagent_device_up", "fxagent_polls_total",
        "fxagent_store_left_seconds", "fxagent_audit_records", "fxagent_poll_lateness_seconds"})
    EXPECT_EQ(text.find(name), text.npos) << name;
  EXPECT_EQ(value_of(text, "fxagent_broker_connected"), "0");
}

TEST(Exposition, WhatIsNotAsItShouldBeIsTold) {
  AgentStatus status = made_up_status();
  FieldHealth field = *status.field;
  field.links[0].doubted = true;
  status.field = std::make_shared<const FieldHealth>(field);
  status.clock_synchronised = false;
  status.conflict = "0ther";
  status.broker.subscribed = false;
  status.store_state = "hangs";
  ++status.samples.collected;
  const std::string text = exposition(status);
  for (const auto& [series, value] :
       std::map<std::string, std::string>{{R"(fxagent_line_doubted{link="line1"})", "1"},
                                          {"fxagent_clock_synchronised", "0"},
                                          {"fxagent_identity_conflict", "1"},
                                          {"fxagent_broker_connected", "1"},
                                          {"fxagent_broker_subscribed", "0"},
                                          {"fxagent_store_on_disk", "0"},
                                          {"fxagent_samples_balanced", "0"}})
    EXPECT_EQ(value_of(text, series), value) << series;
}

TEST(Exposition, DiskThatRefusesIsToldOnlyWhereThereIsToBeAStore) {
  AgentStatus status = made_up_status();
  status.store_state = "memory";
  EXPECT_EQ(value_of(exposition(status), "fxagent_store_on_disk"), "0");
  status.config = std::make_shared<const Config>(plant());
  EXPECT_EQ(exposition(status).find("fxagent_store_on_disk"), std::string::npos);
}

TEST(Exposition, PlaceThatAReloadHasLeftVacantIsNotShown) {
  AgentStatus status = made_up_status();
  Config config = plant_with_store();
  const std::string name = config.devices[0].name;
  ASSERT_NE(exposition(status).find("device=\"" + name + "\""), std::string::npos);
  config.devices[0].name.clear();
  status.config = std::make_shared<const Config>(std::move(config));
  const std::string text = exposition(status);
  EXPECT_EQ(text.find("device=\"" + name + "\""), std::string::npos);
  EXPECT_EQ(text.find("device=\"\""), std::string::npos);
}

// ---- the contract -------------------------------------------------------------------------------

/// Parses a page into name → "type: label label".
std::map<std::string, std::string> families_of(const std::string& text) {
  std::map<std::string, std::string> families;
  std::map<std::string, std::set<std::string>> labels;
  std::string name;
  std::string type;
  const std::regex label("([a-z_]+)=\"");
  for (const std::string& line : lines_of(text)) {
    std::istringstream words(line);
    std::string mark;
    if (line.starts_with("# TYPE ")) {
      words >> mark >> mark >> name >> type;
      families[name] = type;
    } else if (!line.starts_with("#")) {
      EXPECT_TRUE(line.starts_with(name)) << line << " stands below " << name;
      for (std::sregex_iterator at(line.begin(), line.end(), label), end; at != end; ++at)
        if ((*at)[1] != "le") labels[name].insert((*at)[1]);
    }
  }
  for (auto& [each, text_of] : families)
    for (const std::string& one : labels[each]) text_of += " `" + one + "`";
  return families;
}

/// Parses the table in section 10 the same way.
std::map<std::string, std::string> families_of_contract() {
  std::ifstream file(FXAGENT_CONTRACT);
  std::map<std::string, std::string> families;
  const std::regex row(R"(\| `([a-z_]+)` \| (counter|gauge|histogram) \| ((?:`[a-z_]+` ?)*)\| .*)");
  bool inside = false;
  for (std::string line; std::getline(file, line);) {
    if (line.starts_with("## ")) inside = line.starts_with("## 10. ");
    std::smatch cells;
    if (!inside || !std::regex_match(line, cells, row)) continue;
    std::string labels = cells[3];
    while (labels.ends_with(' ')) labels.pop_back();
    families[cells[1]] = cells[2].str() + (labels.empty() ? "" : " " + labels);
  }
  return families;
}

TEST(Exposition, ContractNamesEveryMetricWithTypeAndLabels) {
  EXPECT_EQ(families_of_contract(), families_of(page()));
}

TEST(Exposition, EveryFamilyIsExplainedOnce) {
  std::map<std::string, int> helps;
  for (const std::string& line : lines_of(page()))
    if (line.starts_with("# HELP ")) {
      const std::string name = line.substr(7, line.find(' ', 7) - 7);
      ++helps[name];
      EXPECT_TRUE(line.ends_with(".")) << line;
    }
  for (const auto& [name, type] : families_of(page())) EXPECT_EQ(helps[name], 1) << name;
}

TEST(DurationHistogram, WhatIsEqualToABoundBelongsToIt) {
  DurationHistogram histogram;
  histogram.add(1ms);
  histogram.add(1ms + 1ns);
  histogram.add(-1ms);
  histogram.add(10s);
  histogram.add(10s + 1ns);
  EXPECT_EQ(histogram.counts().front(), 2U);
  EXPECT_EQ(histogram.counts()[1], 1U);
  EXPECT_EQ(histogram.counts()[12], 1U);
  EXPECT_EQ(histogram.counts()[13], 1U);
  EXPECT_EQ(histogram.sum(), 20s + 2ms + 2ns);
}

TEST(Exposition, ClosedConnectionsAreCountedByTheirReason) {
  const std::string text = exposition(made_up_status(), {.slow = 1, .crowded = 2, .unanswered = 3});
  const std::string name = "fxagent_http_connections_closed_total";
  EXPECT_EQ(value_of(text, name + R"({why="slow"})"), "1");
  EXPECT_EQ(value_of(text, name + R"({why="crowded"})"), "2");
  EXPECT_EQ(value_of(text, name + R"({why="unanswered"})"), "3");
}

}  // namespace
}  // namespace fxagent
