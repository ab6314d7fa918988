#include "agent/cli/doctor/examined_device.h"

#include <algorithm>

#include "agent/cli/report/read_report.h"
#include "protocol/plc.h"
#include "protocol/read_way.h"

namespace fxagent {
namespace {

using std::chrono::milliseconds;

/// True if the device answers the whole read in parts of `bits`.
bool answers_in_parts(const ExaminedDevice& device, const Read& whole, std::uint32_t bits) {
  for (std::uint32_t at = whole.span.first_bit; at < whole.span.end_bit(); at += bits) {
    const Span part{whole.span.space, at, std::min(bits, whole.span.end_bit() - at)};
    if (device.ask(Read{part, whole.way}).kind != ProbeAnswer::Kind::data) return false;
  }
  return true;
}

}  // namespace

milliseconds longest_wait(const DeviceConfig& device) {
  return std::max(milliseconds{2000}, device.timeout);
}

std::optional<Request> first_question(const Codec& codec) {
  if (codec.is_broadcast()) return std::nullopt;
  if (const PlcServices* plc = codec.plc()) return plc->run_state();
  return codec.presence();
}

ProbeAnswer greet(LineProbe& probe, const Codec& codec, milliseconds timeout) {
  if (const auto resync = codec.resync(); resync && codec.expects_reply(*resync)) {
    const ProbeAnswer ready = probe.ask(codec, *resync, timeout);
    if (!ready.is_answered()) return ready;
  }
  return probe.ask(codec, *first_question(codec), timeout);
}

bool is_there(const ProbeAnswer& answer, const Codec& codec) {
  return answer.is_answered() && !codec.is_from_gateway(answer.device_code);
}

ProbeAnswer ExaminedDevice::ask(const Request& question) const {
  return probe.ask(*codec, question, longest_wait(device));
}

std::optional<Bytes> ExaminedDevice::read(const Span& span) const {
  for (const ReadWay& way : codec->addresses().read_ways(span.space)) {
    const auto asked = fit(way, {span.first_bit, span.end_bit()});
    if (way.gather != 0 || !asked) continue;
    const auto answer = ask(Read{{span.space, asked->first, asked->end - asked->first}, way.way});
    if (answer.kind != ProbeAnswer::Kind::data) return std::nullopt;
    return extract_bits(answer.image, span.first_bit - asked->first, span.bits);
  }
  return std::nullopt;
}

std::optional<std::uint64_t> ExaminedDevice::word_at(std::string_view name) const {
  if (name.empty()) return std::nullopt;
  const auto address = codec->addresses().parse_address(name, std::nullopt);
  const auto image = address ? read(address->span) : std::nullopt;
  return image ? std::optional(bits_at(*image, 0, address->span.bits)) : std::nullopt;
}

std::uint32_t ExaminedDevice::answered_in_parts(const Read& whole, std::uint32_t usual) const {
  if (usual != 0 && answers_in_parts(*this, whole, usual)) return usual;
  std::uint32_t answered = 0;
  std::uint32_t too_long = (whole.span.bits + kWordBits - 1) / kWordBits;
  while (too_long - answered > 1) {
    const std::uint32_t words = (answered + too_long) / 2;
    (answers_in_parts(*this, whole, words * kWordBits) ? answered : too_long) = words;
  }
  return answered * kWordBits;
}

}  // namespace fxagent
