#include "agent/cli/subcommands.h"

#include <iostream>
#include <optional>

#include "agent/cli/describe/documents.h"
#include "agent/cli/exit_status.h"
#include "agent/cli/report/layout.h"

namespace fxagent {

int run_describe(const DescribeQuestion& what) {
  if (what.schema + what.asyncapi + what.wot != 1)
    return refused("fxagent describe", "give one of --schema, --asyncapi and --wot");
  if (what.path.empty()) {
    if (!what.schema) return refused("fxagent describe", "only --schema works without CONFIG");
    std::cout << json_page(contract::payload_page());
    return kDone;
  }
  const auto config = loaded(what.path);
  if (!config) return kWrong;
  std::cout << json_page(what.schema     ? contract::payload_page(*config)
                         : what.asyncapi ? contract::asyncapi(*config, FXAGENT_VERSION)
                                         : contract::thing(*config, FXAGENT_VERSION));
  return kDone;
}

}  // namespace fxagent
