// A Modbus device: functions 01 to 06, 15, 16, 22 and 23 on the four tables of 65,536.
// Source: Modbus Application Protocol V1.1b3.
// The limits of a real device are settings: holes, fewer registers per read, missing functions.
#pragma once

#include "tests/sim/personality.h"

namespace fxsim {

struct ModbusSettings {
  using Hole = fxsim::Hole;
  std::uint8_t unit = 1;
  std::vector<Hole> holes{};                  // a request that touches a hole gets exception 02
  unsigned max_read = 125;                    // registers per read
  std::uint8_t max_read_code = 3;             // exception for a longer read
  std::vector<unsigned> missing_functions{};  // get exception 01
  std::vector<std::string> identity{};  // maker, product, version; empty: function 43 is missing
};

class Modbus final : public Personality {
 public:
  /// `protocol` is modbus_rtu, modbus_ascii or modbus_tcp.
  Modbus(Protocol protocol, ModbusSettings settings);

  Protocol protocol() const override { return protocol_; }
  std::unique_ptr<Framer> make_framer() const override;
  bool hears(const Frame& frame) const override;
  RequestKind kind(const Frame& frame) const override;
  Ruling execute(const Frame& frame, Plc& plc) const override;
  Bytes refusal(const Frame& frame, std::optional<std::uint16_t> code) const override;
  void spoil(Bytes& reply, Flaw flaw) const override;
  Bytes nobody_there(const Frame& frame) const override;

 private:
  bool is_broadcast(std::uint8_t unit) const;
  std::uint8_t objection(ByteView pdu) const;
  std::uint8_t span_objection(Kind kind, std::size_t first, std::size_t count) const;
  Ruling carry_out(ByteView pdu, Plc& plc) const;

  Protocol protocol_;
  ModbusSettings settings_;
};

}  // namespace fxsim
