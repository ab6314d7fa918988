#include "agent/field/command/command_line_time.h"

#include "agent/line_time.h"
#include "protocol/plan/plan.h"
#include "protocol/plc.h"
#include "protocol/value/pack.h"

namespace fxagent {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;

// Contract: an array that takes longer lets others run between its frames.
constexpr milliseconds kLongArray{2000};

nanoseconds target_time(const Codec& codec, const DeviceConfig& device,
                        std::span<const Holes::Limit> limits, const LineTiming& timing,
                        const AdmittedCommand& admitted, const AdmittedTarget& target) {
  const bool writes = !target.requests.empty();
  const int readings = (writes ? 0 : 1) + (is_read_first(codec, target) ? 1 : 0) +
                       (writes && is_verified(admitted, target) ? 1 : 0);
  return write_time(codec, target.requests, timing) +
         readings * read_time(codec, device, target.point, limits, timing);
}

}  // namespace

nanoseconds set_line_times(const Codec& codec, const DeviceConfig& device,
                           std::span<const Holes::Limit> limits, nanoseconds char_time,
                           AdmittedCommand& admitted) {
  const LineTiming timing = timing_of(device, char_time);
  nanoseconds total{0};
  if (admitted.run_request)  // and one read of the RUN state
    total = exchange_time(codec, *admitted.run_request, timing) +
            exchange_time(codec, codec.plc()->run_state(), timing);
  for (AdmittedTarget& target : admitted.targets) {
    target.line_time = target_time(codec, device, limits, timing, admitted, target);
    total += target.line_time;
  }
  if (char_time.count() > 0) admitted.line_time = total;
  return admitted.run_request ? total + kRunStateVerifiedWithin : total;
}

bool gives_way(const AdmittedTarget& target) { return target.line_time > kLongArray; }

bool gives_way(const AdmittedCommand& admitted) {
  return admitted.targets.size() > 1 ||
         (!admitted.targets.empty() && gives_way(admitted.targets.front()));
}

bool is_read_first(const Codec& codec, const AdmittedTarget& target) {
  if (target.requests.empty()) return false;
  return target.expected || (has_padding(target.point) && !codec.is_broadcast());
}

bool is_verified(const AdmittedCommand& admitted, const AdmittedTarget& target) {
  return target.point.type == DataType::boolean ? admitted.verify_bits : admitted.verify_words;
}

}  // namespace fxagent
