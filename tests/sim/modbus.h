// A Modbus device: functions 01 to 06, 15, 16, 22 and 23 on the four tables of 65,536.
// Sources: Modbus Application Protocol V1.1b3; of the framing, Modbus over Serial Line V1.02 (RTU,
// ASCII) and Modbus Messaging on TCP/IP V1.0b.
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

/// `protocol` is modbus_rtu, modbus_ascii or modbus_tcp, in all functions of this file.
std::unique_ptr<Personality> make_modbus(Protocol protocol, ModbusSettings settings);

/// Function code and data, with the unit it is addressed to or comes from.
struct ModbusMessage {
  std::uint8_t unit = 0;
  Bytes pdu;  // at least the function code
};

/// Creates the framer. A frame with a wrong checksum, or with another protocol than Modbus in its
/// TCP header, is not a frame.
/// An RTU request ends where its function and byte count say. If the function is unknown, or the
/// byte count contradicts the quantity, it ends where the CRC is right. Silence of 50 ms (ASCII: 1
/// s) discards half a request. A TCP header with an impossible length makes the rest of the
/// connection unreadable.
std::unique_ptr<Framer> make_modbus_framer(Protocol protocol);
/// Returns the content of a whole frame of that framer.
ModbusMessage unwrap_modbus(Protocol protocol, ByteView frame);
/// Frames a reply. `request` is the whole frame that it answers.
Bytes wrap_modbus(Protocol protocol, const ModbusMessage& reply, ByteView request);
/// Applies `flaw` to a reply that wrap_modbus() made.
void spoil_modbus(Protocol protocol, Bytes& reply, Flaw flaw);

}  // namespace fxsim
