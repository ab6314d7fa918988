// The agent's status in the Prometheus text format 0.0.4: the content of health, with names and
// units by Prometheus conventions. docs/interface.md, section 10, has names, labels and meanings.
#pragma once

#include <string>

#include "agent/handover/status.h"
#include "agent/http/http_server.h"

namespace fxagent {

/// Returns the page. `status` is from the uplink and has its config. Links and devices that the
/// field has not reported yet are left out. Any thread.
std::string exposition(const AgentStatus& status, const HttpServer::Closed& closed = {});

}  // namespace fxagent
