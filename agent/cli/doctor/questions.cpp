#include "agent/cli/doctor/questions.h"

#include "agent/config/keys.h"
#include "protocol/plc.h"

namespace fxagent {

std::string word_of(Parity parity) {
  return std::string(config_keys::kParities[static_cast<std::size_t>(parity)]);
}

LinkConfig with_line(LinkConfig link, const LineDefaults& line) {
  auto& serial = std::get<SerialSettings>(link.channel);
  serial.baud = line.baud;
  serial.data_bits = line.data_bits;
  serial.parity = line.parity;
  serial.stop_bits = line.stop_bits;
  link.char_time = char_time_of(serial);
  return link;
}

std::optional<Request> first_question(const Codec& codec) {
  if (codec.is_broadcast()) return std::nullopt;
  if (const PlcServices* plc = codec.plc()) return plc->run_state();
  return codec.presence();
}

ProbeAnswer greet(LineProbe& probe, const Codec& codec, std::chrono::milliseconds timeout) {
  if (const auto resync = codec.resync(); resync && codec.expects_reply(*resync)) {
    const ProbeAnswer ready = probe.ask(codec, *resync, timeout);
    if (!ready.is_answered()) return ready;
  }
  return probe.ask(codec, *first_question(codec), timeout);
}

bool is_there(const ProbeAnswer& answer, const Codec& codec) {
  return answer.is_answered() && !codec.is_from_gateway(answer.device_code);
}

}  // namespace fxagent
