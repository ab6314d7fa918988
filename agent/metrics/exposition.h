// The agent's status as Prometheus reads it, the text format 0.0.4: what health has, with names and
// units as Prometheus asks for them. Names, labels and meanings are in agent/CONTRACT.md,
// section 10.
#pragma once

#include <string>

#include "agent/metrics/http_server.h"
#include "agent/status.h"

namespace fxagent {

/// The status is one that the uplink has made: it has its config. A link or device that the field
/// has not told of yet is not in it. Any thread.
std::string exposition(const AgentStatus& status, const HttpServer::Closed& closed = {});

}  // namespace fxagent
