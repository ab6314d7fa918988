// Modbus on the wire, server side: extracts requests from a line and frames replies.
// Sources: Modbus over Serial Line V1.02 (RTU, ASCII), Modbus Messaging on TCP/IP V1.0b.
#pragma once

#include <memory>

#include "tests/sim/personality.h"

namespace fxsim {

/// Function code and data, with the unit it is addressed to or comes from.
struct ModbusMessage {
  std::uint8_t unit = 0;
  Bytes pdu;  // at least the function code
};

/// Creates the framer of modbus_rtu, modbus_ascii or modbus_tcp. A frame with a wrong checksum, or
/// with another protocol than Modbus in its TCP header, is not a frame.
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
