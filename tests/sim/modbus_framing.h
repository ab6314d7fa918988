// Modbus on the wire, the server's side: how a request is cut out of a line and a reply is put on
// it. Sources: Modbus over Serial Line V1.02 (RTU, ASCII), Modbus Messaging on TCP/IP V1.0b.
#pragma once

#include <memory>

#include "tests/sim/personality.h"

namespace fxsim {

/// Function code and what follows it, with the unit it is for or from.
struct ModbusMessage {
  std::uint8_t unit = 0;
  Bytes pdu;  // at least the function code
};

/// Of modbus_rtu, modbus_ascii or modbus_tcp. A frame with a wrong check, or of another protocol
/// than Modbus in its TCP header, is none. RTU requests end where their function and byte count
/// say, those of an unknown function or of a byte count that contradicts the quantity where the CRC
/// is right; 50 ms of silence (ASCII: 1 s) forget half a request. A TCP header whose length cannot
/// be makes the rest of the connection unreadable.
std::unique_ptr<Framer> make_modbus_framer(Protocol protocol);

/// What is in a whole frame of that framer.
ModbusMessage unwrap_modbus(Protocol protocol, ByteView frame);
/// A reply; `request` is the whole frame that it answers.
Bytes wrap_modbus(Protocol protocol, const ModbusMessage& reply, ByteView request);
/// Puts `flaw` into a reply that wrap_modbus() made.
void spoil_modbus(Protocol protocol, Bytes& reply, Flaw flaw);

}  // namespace fxsim
