#include "tests/sim/personality.h"

#include <algorithm>
#include <array>

namespace fxsim {
namespace {

constexpr std::array<std::string_view, 10> kProtocols = {
    "fx-programming-port",
    "fx-computer-link",
    "modbus-rtu",
    "modbus-ascii",
    "modbus-tcp",
    "mc-1e",
    "mc-3e",
    "mc-4e",
    "mc-3c",
    "mc-4c",
};

}  // namespace

std::string_view protocol_name(Protocol protocol) {
  return kProtocols[static_cast<std::size_t>(protocol)];
}

std::optional<Protocol> find_protocol(std::string_view name) {
  const auto found = std::ranges::find(kProtocols, name);
  if (found == kProtocols.end()) return std::nullopt;
  return static_cast<Protocol>(found - kProtocols.begin());
}

std::string protocol_names() { return joined(kProtocols); }

bool is_modbus(Protocol protocol) {
  return protocol == Protocol::modbus_rtu || protocol == Protocol::modbus_ascii ||
         protocol == Protocol::modbus_tcp;
}

bool is_mc_ethernet(Protocol protocol) {
  return protocol == Protocol::mc_1e || protocol == Protocol::mc_3e || protocol == Protocol::mc_4e;
}

bool is_mc_serial(Protocol protocol) {
  return protocol == Protocol::mc_3c || protocol == Protocol::mc_4c;
}

void add_stray(std::uint8_t byte, TimePoint when, std::vector<Frame>& out) {
  if (out.empty() || out.back().whole) out.push_back({{}, false, when});
  out.back().bytes.push_back(byte);
  out.back().complete = when;
}

std::string request_kind_name(RequestKind kind) {
  constexpr std::array<std::string_view, kRequestKinds> kRequests = {
      "read",    "write",     "force_on", "force_off", "enq",
      "control", "handshake", "other",    "malformed"};
  return std::string(kRequests[static_cast<std::size_t>(kind)]);
}

std::string verdict_name(Verdict verdict) {
  static_assert(static_cast<int>(Verdict::silent) == 3, "a new one needs its word");
  constexpr std::array<std::string_view, 4> kVerdicts = {"data", "ack", "nak", "silent"};
  return std::string(kVerdicts[static_cast<std::size_t>(verdict)]);
}

}  // namespace fxsim
