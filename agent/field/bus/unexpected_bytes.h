// Guesses why unexpected bytes arrived: an echo, another master, another protocol, wrong parity or
// speed. The guess and its remedy are for people; no decision depends on them. Pure; any thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>

#include "agent/config/model.h"
#include "protocol/codec.h"
#include "protocol/value/bytes.h"

namespace fxagent {

struct UnexpectedBytes {
  enum class Cause : std::uint8_t {
    unknown,
    echo,            ///< the request itself came back
    another_master,  ///< a valid frame that does not answer this request
    other_settings,  ///< a frame of this protocol with another format or sum setting
    other_protocol,
    parity,
    speed,
  };
  static constexpr std::size_t kCauses = 7;

  Cause cause = Cause::unknown;
  std::string text;  ///< what the bytes look like, and what to do
};

/// Returns the guess for `received`: bytes that came after `asked` was sent to `device` and are not
/// its answer. `asked` is empty if no request was sent. `codec` is the device's current codec.
UnexpectedBytes looks_like(const DeviceConfig& device, const Codec& codec, ByteView asked,
                           ByteView received);

/// Returns the first 16 bytes in hex, and the total number if there are more. Of `most_kept` bytes
/// the caller does not know if more came.
std::string first_bytes(ByteView received,
                        std::size_t most_kept = std::numeric_limits<std::size_t>::max());

}  // namespace fxagent
