// The MC protocol's 1E frame on Ethernet, PLC side: an FX3 behind its ENET module. Commands 00 to
// 05 and 13 to 16, binary or ASCII code.
// Source: FX3U-ENET-ADP User's Manual JY997D45801, FX3U-ENET User's Manual JY997D18101.
#pragma once

#include "tests/sim/mc.h"

namespace fxsim {

class McOneE final : public Personality {
 public:
  explicit McOneE(McSettings settings) : settings_(std::move(settings)) {}

  Protocol protocol() const override { return Protocol::mc_1e; }
  std::unique_ptr<Framer> make_framer() const override;
  bool hears(const Frame&) const override { return true; }
  RequestKind kind(const Frame& frame) const override;
  Ruling execute(const Frame& frame, Plc& plc) const override;
  /// A `code` up to FF is the end code; 5B is sent with abnormal code 10. A greater code contains
  /// both.
  Bytes refusal(const Frame& frame, std::optional<std::uint16_t> code) const override;
  void spoil(Bytes& reply, Flaw flaw) const override;
  std::string command(const Frame& frame) const override;

 private:
  McSettings settings_;
};

}  // namespace fxsim
