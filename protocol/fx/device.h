// Names of FX devices (X17, M8000, TN5, D100.F, K4M0) in the FX protocols. mc/device.h has the
// devices of each model; each protocol decides which of them it reaches.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "protocol/mc/device.h"

namespace fxagent::fx {

using mc::DeviceKind;
using mc::id;
using mc::kind_of;
using mc::kSpaces;
using mc::Model;
using mc::Numbers;
using mc::numbers_of;
using mc::Space;
using mc::span_of;
using mc::to_string;
using mc::width_of;

/// True if requests of some FX name devices of this space. Coils of timers and counters are named
/// when a frame is explained, never addressed.
bool is_addressed(std::uint16_t space);

// As the functions with these names in mc/device.h, for models and devices of an FX up to the FX3U
// only. Call them with their namespace.
std::optional<Model> model_named(std::string_view name);
std::string device_name(Space space, std::uint32_t number);
std::string device_name(const Span& span);
Result<Address> parse_address(Model model, std::string_view text, std::optional<DataType> type);
bool needs_type(std::string_view text);
Result<Span> parse_range(Model model, std::string_view text);
Result<void> check_range(Model model, const Span& span);
/// Accepts a bit, whole bytes of a bit device, and whole words, but never M8034-M8037 and M8118.
Result<void> check_write(Model model, const Span& span);

}  // namespace fxagent::fx
