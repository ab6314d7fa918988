// The MC protocol (SLMP) on Ethernet, PLC side: 3E and 4E in binary or ASCII code.
// Source: MELSEC Communication Protocol Reference Manual SH-080008; FX5 User's Manual (SLMP).
#pragma once

#include "tests/sim/mc_cpu.h"

namespace fxsim {

/// The station a request is addressed to; by default the one the wire leads to.
struct McRoute {
  unsigned network = 0;
  unsigned pc = 0xFF;
  unsigned module_io = 0x3FF;
  unsigned module_station = 0;

  bool operator==(const McRoute&) const = default;
};

/// Settings of 1E, 3E, 4E, 3C and 4C. Each protocol reads the ones it has.
struct McSettings {
  McCode code = McCode::binary;
  Family family = Family::iq_f;
  McRoute route{};
  bool refuses_foreign = true;        // false: does not answer routes to other stations
  std::vector<McRoute> neighbours{};  // routes that other stations of the line answer
  unsigned station = 0;               // this and the following: 3C and 4C only
  unsigned format = 4;
  bool sum_check = true;
  McCpuSettings cpu{};
};

class McEthernet final : public Personality {
 public:
  /// `protocol` is mc_3e or mc_4e. Both answer both frames, with one exception: a Q or L with
  /// mc_3e, which models its own Ethernet port, does not answer 4E.
  McEthernet(Protocol protocol, McSettings settings);

  Protocol protocol() const override { return protocol_; }
  std::unique_ptr<Framer> make_framer() const override;
  bool hears(const Frame& frame) const override;
  RequestKind kind(const Frame& frame) const override;
  Ruling execute(const Frame& frame, Plc& plc) const override;
  Bytes refusal(const Frame& frame, std::optional<std::uint16_t> code) const override;
  void spoil(Bytes& reply, Flaw flaw) const override;
  std::string command(const Frame& frame) const override;

 private:
  McRequest request_of(const Frame& frame) const;
  std::uint16_t end_code(McRefusal refusal) const;

  Protocol protocol_;
  McSettings settings_;
};

/// "0401/0000".
std::string mc_command_name(const McRequest& request);
/// Converts an outcome to a Ruling without a reply.
Ruling mc_ruling(const McOutcome& outcome, const McRequest& request);

}  // namespace fxsim
