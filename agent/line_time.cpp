#include "agent/line_time.h"

#include <algorithm>
#include <utility>
#include <variant>

#include "protocol/plc.h"

namespace fxagent {

using std::chrono::nanoseconds;

std::optional<Request> background_question(const Codec& codec, bool has_tags) {
  if (const PlcServices* plc = codec.plc()) return plc->run_state();
  return has_tags ? std::nullopt : codec.presence();
}

LineTiming timing_of(const DeviceConfig& device, nanoseconds char_time) {
  return {char_time, device.gap, device.turnaround, device.enquire == EnquirePolicy::always};
}

LineCost cost_of(const DeviceConfig& device, nanoseconds char_time, nanoseconds turnaround) {
  return {char_time, turnaround + device.gap};
}

nanoseconds exchange_time(const Codec& codec, const Request& request, const LineTiming& timing) {
  const auto one = [&](const Request& asked) {
    const LineLength length = codec.line_length(asked);
    return timing.char_time * (length.request_chars + length.reply_chars + length.more_reply_chars +
                               length.closing_chars) +
           timing.turnaround + std::max(timing.gap, codec.quiet_before(timing.char_time)) +
           codec.pause_after(asked);
  };
  const auto enquiry = codec.resync();
  return enquiry && timing.enquires_always ? one(*enquiry) + one(request) : one(request);
}

Plan reads_of(const Codec& codec, const DeviceConfig& device, const Point& point,
              std::span<const Holes::Limit> limits) {
  const std::span only(&point, 1);
  const auto plan_with = [&](const Holes& holes) {
    return make_plan(codec, only, LineCost{}, device.max_block_bytes, holes);
  };
  Holes holes;
  holes.limits.assign(limits.begin(), limits.end());
  // Assume no multi-block reads: the device may lack them, and only polls find that out.
  for (const GatherCommand& command : codec.addresses().gathers())
    holes.gather_limits.push_back({command.gather, 0});
  if (Plan plan = plan_with(holes); !plan.reads.empty()) return plan;
  holes.gather_limits.clear();
  return plan_with(holes);
}

nanoseconds read_time(const Codec& codec, const DeviceConfig& device, const Point& point,
                      std::span<const Holes::Limit> limits, const LineTiming& timing) {
  return poll_time(codec, reads_of(codec, device, point, limits), timing);
}

std::vector<GroupPlan> group_plans(const Codec& codec, const DeviceConfig& device,
                                   nanoseconds char_time) {
  const LineCost cost = cost_of(device, char_time, device.turnaround);
  std::vector<GroupPlan> plans;
  for (std::uint32_t g = 0; g < device.groups.size(); ++g) {
    GroupPlan of_group{g, {}, {}, {}};
    for (const TagConfig& tag : device.tags) {
      if (tag.group != g) continue;
      of_group.tags.push_back(&tag);
      of_group.points.push_back(tag.point);
    }
    if (of_group.tags.empty()) continue;
    of_group.plan = make_plan(codec, of_group.points, cost, device.max_block_bytes);
    plans.push_back(std::move(of_group));
  }
  return plans;
}

nanoseconds poll_time(const Codec& codec, const Plan& plan, const LineTiming& timing) {
  nanoseconds total{0};
  for (const ReadIndices reads : plan.exchanges)
    total += exchange_time(codec, plan.request(reads), timing);
  return total;
}

nanoseconds write_time(const Codec& codec, std::span<const Request> requests,
                       const LineTiming& timing) {
  nanoseconds total{0};
  for (Request request : requests) {
    if (const auto first = codec.read_before(request)) {
      total += exchange_time(codec, *first, timing);
      // The bytes of the write depend on the answer, but its length does not.
      const auto* read = std::get_if<Read>(&*first);
      request = codec.with_read(request, Bytes(read != nullptr ? (read->span.bits + 7) / 8 : 0));
    }
    total += exchange_time(codec, request, timing);
  }
  return total;
}

nanoseconds longest_poll(const Codec& codec, std::span<const Plan* const> plans,
                         const LineTiming& timing) {
  nanoseconds longest{0};
  for (const Plan* plan : plans)
    for (const ReadIndices reads : plan->exchanges)
      longest = std::max(longest, exchange_time(codec, plan->request(reads), timing));
  if (const auto question = background_question(codec, !plans.empty()))
    longest = std::max(longest, exchange_time(codec, *question, timing));
  if (const PlcServices* plc = codec.plc(); plc != nullptr && !plc->model().empty())
    for (const Request& question : plc->identify())
      longest = std::max(longest, exchange_time(codec, question, timing));
  return longest;
}

}  // namespace fxagent
