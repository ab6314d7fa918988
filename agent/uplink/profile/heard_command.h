// What profiles have in common when they hear a command. Pure functions, except for the log.
#pragma once

#include <string>
#include <string_view>

#include "agent/config/model.h"
#include "agent/handover/command_message.h"
#include "agent/uplink/broker.h"

namespace fxagent {

/// Logs that the message is not carried out, and why.
void ignore_command(const Message& message, const std::string& note);

/// True, and logged, if `name` is that of a link. Commands for links come from the broker of `mqtt`
/// only.
bool is_for_link(const Config& config, const Message& message, std::string_view name);

/// Returns the order for a device, with the properties of the message and without its payload.
/// `sender` is for the audit.
Order order_of(const Message& message, std::string device, std::string sender);

/// Returns the command that writes `value`, which is JSON, to a tag.
std::string write_command(std::string_view id, std::string_view tag, std::string_view value);

}  // namespace fxagent
