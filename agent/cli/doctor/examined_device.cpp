#include "agent/cli/doctor/examined_device.h"

#include <algorithm>

#include "agent/cli/report/read_report.h"
#include "protocol/plc.h"

namespace fxagent {
namespace {

using std::chrono::milliseconds;

/// Returns half of it in whole words; 0 below one.
std::uint32_t half_of(std::uint32_t bits) {
  return bits <= kWordBits ? 0 : (bits / 2 + kWordBits - 1) / kWordBits * kWordBits;
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
    const std::uint32_t before = span.first_bit % way.align_bits;
    Span asked{span.space, span.first_bit - before, span.bits + before};
    asked.bits += (way.unit_bits - asked.bits % way.unit_bits) % way.unit_bits;
    const bool reaches = asked.first_bit >= way.first_bit && asked.end_bit() <= way.end_bit;
    if (way.gather != 0 || !reaches || asked.bits > way.max_bits) continue;
    const auto answer = ask(Read{asked, way.way});
    if (answer.kind != ProbeAnswer::Kind::data) return std::nullopt;
    return extract_bits(answer.image, before, span.bits);
  }
  return std::nullopt;
}

std::optional<std::uint64_t> ExaminedDevice::word_at(std::string_view name) const {
  if (name.empty()) return std::nullopt;
  const auto address = codec->addresses().parse_address(name, std::nullopt);
  const auto image = address ? read(address->span) : std::nullopt;
  return image ? std::optional(bits_at(*image, 0, address->span.bits)) : std::nullopt;
}

std::uint32_t ExaminedDevice::answered_in_parts(const Read& whole) const {
  for (std::uint32_t bits = half_of(whole.span.bits); bits > 0; bits = half_of(bits)) {
    bool is_answered = true;
    for (std::uint32_t at = whole.span.first_bit; is_answered && at < whole.span.end_bit();
         at += bits) {
      const Span part{whole.span.space, at, std::min(bits, whole.span.end_bit() - at)};
      is_answered = ask(Read{part, whole.way}).kind == ProbeAnswer::Kind::data;
    }
    if (is_answered) return bits;
  }
  return 0;
}

}  // namespace fxagent
