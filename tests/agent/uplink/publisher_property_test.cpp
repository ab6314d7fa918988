#include <gtest/gtest.h>

#include <random>

#include "tests/agent/store/power_cut.h"
#include "tests/agent/uplink/publisher_bench.h"
#include "tests/support/effort.h"

namespace fxagent {
namespace {

using nlohmann::json;
using test::kBase;
using test::seqs;
using Bench = test::PublisherBench;
using namespace std::chrono_literals;

// Invariants under any behaviour of broker and disk: every sample is in exactly one place at every
// step, the window is respected, and after recovery every missing sample was counted.
enum class Keeping : std::uint8_t { memory, offline, always, offline_frozen, always_frozen };
class PublisherProperty : public testing::TestWithParam<std::tuple<unsigned, Keeping>> {};

TEST_P(PublisherProperty, NothingIsLostWithoutBeingCounted) {
  const auto [seed, keeping] = GetParam();
  std::mt19937 random(seed);
  const auto below = [&](unsigned n) {
    return static_cast<unsigned>(std::uniform_int_distribution<unsigned>(0, n - 1)(random));
  };
  const bool always = keeping == Keeping::always || keeping == Keeping::always_frozen;
  const bool freezes = keeping == Keeping::offline_frozen || keeping == Keeping::always_frozen;
  test::PowerCut disk;
  const test::Scratch scratch;
  Bench bench(keeping == Keeping::memory ? "" : scratch.path("store"));
  bench.config.store.sync_always = always;
  bench.config.store.max_bytes = 20000;
  bench.settings.backlog_bytes = 20000;
  bench.settings.jitter_seed = seed;
  bench.broker.receive_maximum = 1 + below(30);
  bench.broker.acknowledges = false;
  const std::size_t window = std::min(20U, bench.broker.receive_maximum);
  std::optional<test::Frost> frost;
  bench.step();
  std::uint64_t seq = 0;
  std::uint64_t suppressed = 0;
  std::set<std::string> ids;
  for (int i = 0; i < test::effort(3000); ++i) {
    switch (below(12)) {
      case 0:
      case 1:
      case 2:
        for (unsigned n = below(6); n > 0; --n)
          bench.outbox.push(test::sample(++seq, below(2), below(2)));
        break;
      case 3: {
        CommandResult result = test::succeeded("id" + std::to_string(i));
        ids.insert(result.id);
        if (below(2) == 0) result.response_topic = kBase + "/press1/result/hmi";
        bench.outbox.push(std::move(result));
        break;
      }
      case 4:
        bench.outbox.push(test::offline(below(2), "timeout", i));
        break;
      case 5:
      case 6:
      case 7:
        for (unsigned n = below(25); n > 0 && bench.broker.open() > 0; --n)
          bench.broker.acknowledge_next();
        break;
      case 8:
        if (bench.broker.open() > 0 && below(2) == 0) {
          // Codes such as 0x90 also drop results, so this test leaves them out.
          const int codes[] = {0, 0x80, 0x87, 0x97};
          bench.broker.refuse_next(codes[below(4)]);
        }
        break;
      case 9:
        if (bench.broker.up() && below(8) == 0) bench.broker.lose();
        break;
      case 10:
        bench.broker.reachable = below(3) != 0;
        break;
      case 11: {
        suppressed += below(3);
        bench.outbox.push(test::counted(seq + suppressed, suppressed));
        break;
      }
      default:
        break;
    }
    if (freezes && below(40) == 0) {
      frost ? frost.reset() : static_cast<void>(frost.emplace(disk));
      bench.guarded->set_patience(frost ? std::chrono::milliseconds(1) : 1h);
    }
    bench.now += std::chrono::milliseconds(below(400));
    bench.step();
    ASSERT_LE(bench.broker.open(), window);
  }
  frost.reset();
  if (bench.guarded) bench.guarded->set_patience(1h);
  while (bench.guarded && bench.guarded->state() == "hangs") {
    bench.outbox.wait_until(std::chrono::steady_clock::now() + 10s);
    bench.step();
  }
  bench.broker.reachable = true;
  bench.broker.acknowledges = true;
  bench.broker.acknowledge_all();
  for (int i = 0; i < 200; ++i) bench.advance(1s);

  const SampleCounts samples = bench.made().samples();
  EXPECT_EQ(samples.queued + samples.in_flight + samples.stored, 0U);
  EXPECT_EQ(samples.acknowledged + samples.dropped, seq);
  std::set<std::uint64_t> arrived;
  std::set<std::string> answered;
  std::map<std::string, std::uint64_t> last_live;
  for (const Publication& p : bench.broker.taken) {
    if (p.topic.find("/data/") != std::string::npos) {
      for (const std::uint64_t each : seqs({p.payload})) arrived.insert(each);
      if (!p.topic.ends_with("/history")) {
        const std::uint64_t each = seqs({p.payload}).at(0);
        EXPECT_GT(each, last_live[p.topic]);
        last_live[p.topic] = each;
      }
    }
    if (p.topic.ends_with("/result")) answered.insert(json::parse(p.payload)["id"]);
    if (p.topic.ends_with("/health")) {
      const json s = json::parse(p.payload)["samples"];
      EXPECT_EQ(s["collected"].get<int>() + s["recovered"].get<int>(),
                s["suppressed"].get<int>() + s["queued"].get<int>() + s["in_flight"].get<int>() +
                    s["stored"].get<int>() + s["acknowledged"].get<int>() +
                    s["dropped"].get<int>());
    }
  }
  // A row may arrive although it was dropped to make room; every row that did not arrive was
  // counted.
  EXPECT_GE(arrived.size(), samples.acknowledged);
  EXPECT_EQ(answered, ids);
}

INSTANTIATE_TEST_SUITE_P(Seeds, PublisherProperty,
                         testing::Combine(testing::Range(1U, 21U),
                                          testing::Values(Keeping::memory)));
INSTANTIATE_TEST_SUITE_P(SeedsWithAStore, PublisherProperty,
                         testing::Combine(testing::Range(21U, 27U),
                                          testing::Values(Keeping::offline, Keeping::always)));
INSTANTIATE_TEST_SUITE_P(SeedsWithAStoreThatHangs, PublisherProperty,
                         testing::Combine(testing::Range(27U, 31U),
                                          testing::Values(Keeping::offline_frozen,
                                                          Keeping::always_frozen)));

}  // namespace
}  // namespace fxagent
