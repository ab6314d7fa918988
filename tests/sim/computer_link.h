// The Mitsubishi FX computer link ("dedicated protocol"), PLC side: BR WR BW WW BT WT RR RS PC TT
// GW, and QR QW QT on FX3.
// Source: Mitsubishi JY992D69901 rev. E, chapters 7, 8 and 12; FX3 ranges from the FX3U-ENET
// manual. The checks run in the order of 12.4.1: of several errors, the smallest code is sent.
// On-demand messages, which the PLC initiates, are not simulated.
#pragma once

#include "tests/sim/personality.h"

namespace fxsim {

struct ComputerLinkSettings {
  unsigned station = 0;  // D8121, 0 to 15
  unsigned format = 1;   // 1, or 4: CR LF after every message
  bool sum_check = true;
};

class ComputerLink final : public Personality {
 public:
  explicit ComputerLink(ComputerLinkSettings settings) : settings_(settings) {}

  Protocol protocol() const override { return Protocol::computer_link; }
  std::unique_ptr<Framer> make_framer() const override;
  bool hears(const Frame& frame) const override;
  RequestKind kind(const Frame& frame) const override;
  Ruling execute(const Frame& frame, Plc& plc) const override;
  Bytes refusal(const Frame& frame, std::optional<std::uint16_t> code) const override;
  void spoil(Bytes& reply, Flaw flaw) const override;

 private:
  Bytes closed(Bytes message) const;
  Bytes data_reply(std::string_view data) const;
  Bytes acknowledgement() const;
  Ruling nak(std::uint8_t code, std::string why) const;

  ComputerLinkSettings settings_;
};

}  // namespace fxsim
