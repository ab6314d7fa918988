// `fxagent audit`: the commands that an agent has received, from the file of its store, and whether
// the records of them are whole.
#pragma once

#include <string>

#include "agent/config/config.h"

namespace fxagent {

struct AuditQuestion {
  std::string since;  ///< empty: all; see audit::since_from()
  std::string head;   ///< empty: none; "RECORDS:HASH" of a health message, for `verify`
  bool verify = false;
  bool as_json = false;
};

/// Prints to stdout. The agent may run meanwhile. Exit status: 0; 1 where `verify` found something;
/// 2 where the question is wrong, or there is no audit, which stderr tells.
int run_audit(const Config& config, const AuditQuestion& question);

}  // namespace fxagent
