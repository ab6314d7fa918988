// `fxagent audit`: lists the commands that an agent has received, read from its store file, and
// checks that the audit records are complete.
#pragma once

#include <string>

#include "agent/config/model.h"

namespace fxagent {

struct AuditQuestion {
  std::string since;  ///< empty: all records; see audit::since_from()
  std::string head;   ///< for `verify`: "RECORDS:HASH" of a health message; empty: none
  bool verify = false;
  bool as_json = false;
};

/// Prints to stdout. Works while the agent runs. Exit status: 0; 1 if `verify` found a fault; 2 if
/// an argument is wrong or there is no audit (reason on stderr).
int run_audit(const Config& config, const AuditQuestion& question);

}  // namespace fxagent
