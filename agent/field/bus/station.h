// The properties of a device that the bus needs.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <string_view>

#include "agent/config/model.h"
#include "agent/config/wiring.h"
#include "agent/handover/command_message.h"
#include "agent/recorder/frame_ring.h"
#include "protocol/codec.h"

namespace fxagent {

/// Must outlive the exchange.
struct Station {
  /// Codec of the device, or of the command in progress. A trace shares it until it has explained
  /// its frames.
  std::shared_ptr<const Codec> codec;
  std::string_view device;  ///< its name; empty: unknown
  std::chrono::milliseconds timeout{1000};
  std::chrono::milliseconds gap{0};
  EnquirePolicy enquire = EnquirePolicy::open;
  bool echo = false;               ///< the line echoes what is sent
  Wiring wiring;                   ///< for error texts
  std::uint32_t handshake_in = 0;  ///< Channel::session() of its last answered enquiry; 0: none
  std::uint16_t recorded_as = kNoDevice;  ///< FrameRing::number() of the device
  FrameTrace* trace = nullptr;            ///< receives every frame of a command; null for polls
};

}  // namespace fxagent
