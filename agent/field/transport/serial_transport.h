// A serial port: raw termios, exclusive, reopened by its path after it has vanished. Field thread
// only.
#pragma once

#include <asio/any_io_executor.hpp>
#include <memory>

#include "agent/config/model.h"
#include "agent/field/transport/transport.h"

namespace fxagent {

/// Returns a closed port; open() opens `settings.path`. On a pty, 7 data bits and parity are
/// tolerated although the kernel does not keep them (there is no line). On a real port such a
/// refusal is an error.
std::unique_ptr<Transport> make_serial_transport(asio::any_io_executor executor,
                                                 SerialSettings settings);

}  // namespace fxagent
