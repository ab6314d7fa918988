#include "agent/field/link/group_plans.h"

#include <algorithm>
#include <span>
#include <utility>
#include <variant>

#include "agent/line_time.h"
#include "agent/log/log.h"
#include "protocol/plc.h"

namespace fxagent {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;
using Clock = std::chrono::steady_clock;

// A cycle searches for what is missing until refusals have taken this long, which is about half of
// the search, and allows at least this many. One missing place among 10,000 takes fewer.
constexpr milliseconds kRefusedTime{5000};
constexpr std::uint32_t kFewRefusals = 32;

bool has_way_by_itself(const AddressSpace& addresses, std::uint16_t space) {
  const auto ways = addresses.read_ways(space);
  return std::any_of(ways.begin(), ways.end(), [](const ReadWay& way) { return way.gather == 0; });
}

/// Returns HoleMap::version() of the device.
std::uint32_t holes_version(const LinkDevice& device) {
  return device.holes ? device.holes->version() : 0;
}

}  // namespace

Plan GroupPlans::plan_of(const LinkDevice& device, const GroupPoll& group,
                         const std::vector<Point>& points) const {
  const LineCost cost = cost_of(device.config, link_.config.char_time, group.turnaround);
  return make_plan(*device.codec, points, cost, device.config.max_block_bytes,
                   device.holes ? device.holes->holes() : Holes{});
}

void GroupPlans::make(LinkDevice& device, GroupPoll& group) {
  group.turnaround = device.turnaround.value();
  group.holes_version = holes_version(device);
  group.cycle.use(plan_of(device, group, group.cycle.points()), link_.bus.doubt().findings());
  link_.scheduler.group(group.id).set_exchanges(group.cycle.reads().plan().exchange_count());
}

void GroupPlans::make_all(LinkDevice& device) {
  for (const auto& group : device.groups) make(device, *group);
}

void GroupPlans::refresh(LinkDevice& device, GroupPoll& group) {
  if (device.holes) device.holes->retry(Clock::now());
  bool stale = group.holes_version != holes_version(device);
  const nanoseconds planned_with = device.turnaround.value();
  if (device.turnaround.review())
    log::info("device", {{"device", device.config.name},
                         {"turnaround_ms", whole_ms(device.turnaround.value())},
                         {"planned_with_ms", whole_ms(planned_with)}});
  // Without a line speed, a plan has the fewest exchanges, whatever their line time.
  if (link_.config.char_time.count() > 0) stale |= group.turnaround != device.turnaround.value();
  if (stale) make(device, group);
}

nanoseconds GroupPlans::longest_poll() const {
  nanoseconds longest{0};
  for (const auto& device : link_.devices) {
    const LineTiming timing = timing_of(device->config, link_.config.char_time);
    std::vector<const Plan*> plans;
    for (const auto& group : device->groups) plans.push_back(&group->cycle.reads().plan());
    nanoseconds of_device = fxagent::longest_poll(*device->codec, plans, timing);
    // The questions about the model count as one exchange with the read that follows them.
    if (!device->state.is_model_known())
      for (const Request& question : device->config.codec->plc()->identify())
        of_device += exchange_time(*device->codec, question, timing);
    longest = std::max(longest, of_device);
  }
  return longest;
}

// ---- holes --------------------------------------------------------------------------------------

void GroupPlans::refused(LinkDevice& device, GroupPoll& group, ReadIndices reads,
                         const Request& request, const Exchange& exchange) {
  const AddressSpace& addresses = device.codec->addresses();
  const PlannedRead& planned = group.cycle.reads().plan().reads[reads[0]];
  if (const auto* gather = std::get_if<Gather>(&request)) {
    if (gather->parts.size() > 1 || has_way_by_itself(addresses, planned.read.span.space))
      return device.found_holes().refused_together(
          *gather, asked_in(group.cycle.reads().plan(), reads, group.cycle.points()));
  }
  const std::vector<Point> points = group.cycle.points();
  const auto halves = halves_of(*device.codec, points, planned);
  device.found_holes().refused(planned.read.span, halves, exchange.ended,
                               addresses.gathers().empty()
                                   ? std::vector<Span>{}
                                   : asked_in(group.cycle.reads().plan(), reads, points));
  if (!halves)
    log::warn("device", {{"device", device.config.name},
                         {"refused", names_of(addresses, planned.read.span)},
                         {"reason", exchange.reply.text}});
}

void GroupPlans::read_in_parts(LinkDevice& device, GroupPoll& group, ReadIndices reads,
                               nanoseconds line_time) {
  group.refused_time += line_time;
  if (++group.refusals > kFewRefusals && group.refused_time > kRefusedTime) return;
  PollCycle& cycle = group.cycle;
  if (reads.size() > 1)
    cycle.reads().read_halves(reads);
  else if (!read_by_other_ways(device, group, cycle.reads().points_of(reads)))
    return;
  link_.scheduler.group(group.id).extend_cycle(cycle.reads().plan().exchange_count(), line_time,
                                               Clock::now());
}

bool GroupPlans::read_by_other_ways(LinkDevice& device, GroupPoll& group,
                                    const std::vector<std::uint32_t>& points) {
  std::vector<Point> refused;
  refused.reserve(points.size());
  for (const std::uint32_t point : points)
    refused.push_back(device.config.tags[group.cycle.tags()[point]].point);
  Plan part = plan_of(device, group, refused);
  // Waiting commands have a bound that relies on longest_poll().
  const Plan* only = &part;
  if (link_.scheduler.share().commands_waiting() > 0 &&
      fxagent::longest_poll(*device.codec, std::span(&only, 1),
                            timing_of(device.config, link_.config.char_time)) > longest_poll())
    return false;
  group.cycle.reads().read_instead(points, std::move(part));
  return true;
}

void GroupPlans::were_read(LinkDevice& device, const GroupPoll& group, ReadIndices reads) {
  if (!device.holes) return;
  for (const std::uint32_t read : reads)
    device.holes->read(group.cycle.reads().plan().reads[read].read.span, reads.size());
}

// ---- commands for several places ----------------------------------------------------------------

void GroupPlans::doubt_command(LinkDevice& device, const Request& request) {
  const auto* gather = std::get_if<Gather>(&request);
  if (gather == nullptr) return;
  const AddressSpace& addresses = device.codec->addresses();
  if (std::all_of(gather->parts.begin(), gather->parts.end(),
                  [&](const Read& part) { return has_way_by_itself(addresses, part.span.space); }))
    device.found_holes().unanswered(gather->parts.front().gather);
}

bool GroupPlans::proves_command(LinkDevice& device, const Request& request) {
  if (device.holes == nullptr) return false;
  const auto* gather = std::get_if<Gather>(&request);
  const HoleMap::Proof proof =
      device.holes->answered(gather == nullptr ? std::uint8_t{0} : gather->parts.front().gather);
  for (const std::uint8_t lacking : proof.lacking)
    give_up_command(device, lacking,
                    "no answer or a damaged one, although the device answers others");
  if (proof.again) make_all(device);
  return proof.again || !proof.lacking.empty();
}

void GroupPlans::give_up_command(LinkDevice& device, std::uint8_t gather,
                                 const std::string& reason) {
  if (device.found_holes().lacks(gather, Clock::now()))
    log::info("device", {{"device", device.config.name},
                         {"refused", "a read of several places in one frame"},
                         {"reason", reason},
                         {"note", "this device lacks the command: the agent reads without it"}});
  // The running cycles begin anew, so that no tag is bad for lack of a command.
  make_all(device);
}

}  // namespace fxagent
