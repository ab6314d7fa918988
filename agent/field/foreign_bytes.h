// What bytes may be that are no answer: an echo, another master, another protocol, the wrong
// parity or speed. A guess for people, with the cure; nothing is decided by it. Pure; any thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "agent/config/config.h"
#include "protocol/bytes.h"
#include "protocol/codec.h"

namespace fxagent {

struct ForeignBytes {
  enum class Cause : std::uint8_t {
    unknown,
    echo,            ///< the question itself came back
    another_master,  ///< a good frame that is no answer to this question
    other_settings,  ///< a frame of this protocol with another format or without its sum
    other_protocol,
    parity,
    speed,
  };
  static constexpr std::size_t kCauses = 7;

  Cause cause = Cause::unknown;
  std::string text;  ///< what they look like, and what to do
};

/// `heard` came after `asked` was sent (empty: nobody had asked) to `device`, whose codec of the
/// moment is `codec`, and was not its answer.
ForeignBytes looks_like(const DeviceConfig& device, const Codec& codec, ByteView asked,
                        ByteView heard);

/// The first 16 of them in hex, and how many there are where that is more.
std::string first_bytes(ByteView heard);

}  // namespace fxagent
