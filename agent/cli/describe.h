// `fxagent describe`: the agent's topics and payloads for other programs.
#pragma once

#include <string>

namespace fxagent {

struct DescribeQuestion {
  std::string path;       ///< config file; empty: any agent, with `schema` only
  bool schema = false;    ///< JSON Schema of every payload
  bool asyncapi = false;  ///< AsyncAPI document
  bool wot = false;       ///< W3C Thing Description
};

/// Prints the document to stdout; exactly one of the three must be set. Exit status: 0, or 2 with
/// the reason on stderr.
int run_describe(const DescribeQuestion& what);

}  // namespace fxagent
