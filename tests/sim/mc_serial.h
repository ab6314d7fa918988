// The MC protocol on a serial line, PLC side: frames 3C and 4C in formats 1 to 4, and 4C in format
// 5.
// Source: MELSEC Communication Protocol Reference Manual SH-080008, 4.2.
#pragma once

#include "tests/sim/mc.h"

namespace fxsim {

class McSerial final : public Personality {
 public:
  /// `protocol` is mc_3c or mc_4c; in formats 1 to 4 both answer both frames.
  McSerial(Protocol protocol, McSettings settings);

  Protocol protocol() const override { return protocol_; }
  std::unique_ptr<Framer> make_framer() const override;
  bool hears(const Frame& frame) const override;
  RequestKind kind(const Frame& frame) const override;
  Ruling execute(const Frame& frame, Plc& plc) const override;
  Bytes refusal(const Frame& frame, std::optional<std::uint16_t> code) const override;
  void spoil(Bytes& reply, Flaw flaw) const override;
  std::string command(const Frame& frame) const override;

 private:
  McCode code() const { return settings_.format == 5 ? McCode::binary : McCode::ascii; }
  std::uint16_t end_code(McRefusal refusal) const;
  Bytes answer(const Frame& frame, ByteView data) const;

  Protocol protocol_;
  McSettings settings_;
};

}  // namespace fxsim
