// The section `recorder`.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "agent/config/config_difference.h"
#include "tests/agent/config/small_plant.h"

namespace fxagent {
namespace {

using namespace test;

std::string with_recorder(const std::string& more) {
  return changed("/recorder", R"({"path": "/var/lib/fxagent/recordings")" + more + "}");
}

TEST(ConfigRecorder, IsOffUnlessThereIsAPath) {
  EXPECT_FALSE(good(without("/metrics")).recorder);
  expect_refused("/recorder", "{}", {"path"});
  const auto recorder = good(with_recorder("")).recorder;
  ASSERT_TRUE(recorder);
  EXPECT_EQ(recorder->path, "/var/lib/fxagent/recordings");
  EXPECT_EQ(recorder->files, 20U);
  EXPECT_EQ(recorder->max_bytes, 32U << 20);
}

TEST(ConfigRecorder, LinksShareTheMemory) {
  const RecorderConfig recorder;
  EXPECT_EQ(ring_bytes(recorder, 0), 256U << 10);
  EXPECT_EQ(ring_bytes(recorder, 64), 256U << 10);
  EXPECT_EQ(ring_bytes(recorder, 1000), (16U << 20) / 1000);
  EXPECT_EQ(ring_bytes(recorder, 10'000), 4096U);
  RecorderConfig given;
  given.link_bytes = 8192;
  EXPECT_EQ(ring_bytes(given, 1), 8192U);
}

TEST(ConfigRecorder, ARecordingMustFit) {
  EXPECT_EQ(
      good(with_recorder(R"(, "link_bytes": 65536, "max_bytes": 262144)")).recorder->link_bytes,
      65536U);
  expect_error(with_recorder(R"(, "link_bytes": 65536, "max_bytes": 262143)"), "/recorder",
               {"at least 4 times link_bytes"});
}

TEST(ConfigRecorder, TheRingsMustFitIntoTheMemory) {
  nlohmann::json plant = nlohmann::json::parse(
      with_recorder(R"(, "link_bytes": 16777216, "max_bytes": 9007199254740992)"));
  good(plant.dump());
  for (int i = 0; i < 3; ++i)
    plant["links"].push_back({{"name", "spare" + std::to_string(i)},
                              {"tcp", {{"host", "192.0.2.2" + std::to_string(i)}, {"port", 502}}}});
  expect_error(plant.dump(1), "/recorder", {"link_bytes must be lower", "64 MiB"});
}

TEST(ConfigRecorder, AChangeNeedsARestart) {
  const Config before = good(with_recorder(""));
  EXPECT_TRUE(needs_restart(before, good(with_recorder(""))).empty());
  const auto errors = needs_restart(before, good(with_recorder(R"(, "files": 3)")));
  expect_error(errors, "/recorder", {});
  EXPECT_EQ(needs_restart(good(without("/metrics")), before).size(), 2U) << "metrics, recorder";
}

}  // namespace
}  // namespace fxagent
