// Questions of `fxagent doctor` and `fxagent scan` to one device. They only read.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <set>
#include <string_view>

#include "agent/config/model.h"
#include "agent/field/line_probe.h"
#include "protocol/codec.h"

namespace fxagent {

/// Returns the wait for an answer: at least 2 s, so that a device slower than its configured
/// timeout is found.
std::chrono::milliseconds longest_wait(const DeviceConfig& device);

/// Returns the first question to a device; nullopt: none would be answered.
std::optional<Request> first_question(const Codec& codec);
/// Asks the first question, which must exist, after putting the receiver into a known state.
ProbeAnswer greet(LineProbe& probe, const Codec& codec, std::chrono::milliseconds timeout);
/// True if the device itself has answered, even with a refusal.
bool is_there(const ProbeAnswer& answer, const Codec& codec);

/// A device that answers.
struct ExaminedDevice {
  LineProbe& probe;
  const DeviceConfig& device;
  std::shared_ptr<const Codec> codec;    ///< of the address and the model that it has
  std::set<const TagConfig*> refused{};  ///< tags that it does not return

  ProbeAnswer ask(const Request& question) const;
  /// Returns the image of the span, from its first bit on.
  std::optional<Bytes> read(const Span& span) const;
  /// Returns the bit or word at this address; nullopt if there is no name, if the model lacks it,
  /// or if it cannot be read.
  std::optional<std::uint64_t> word_at(std::string_view name) const;
  /// Returns the largest parts in which a refused read is answered, in bits: whole words. Returns
  /// `usual` if that is not 0 and such parts are answered. 0: some of the read does not exist.
  std::uint32_t answered_in_parts(const Read& whole, std::uint32_t usual) const;
};

}  // namespace fxagent
