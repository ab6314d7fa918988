// Feeds arbitrary bytes from a file or topic to the config loader, the command parser and the
// reader of journalled results. Nothing may crash, and every published result must be JSON.
#include <cstdint>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

#include "agent/commands/parse/parse.h"
#include "agent/commands/result.h"
#include "agent/config/loader.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  (void)fxagent::parse_config(text, [](std::string_view) { return std::nullopt; });
  (void)fxagent::parse_command(text);
  const auto recorded = fxagent::recorded_result(std::string(text));
  if (!nlohmann::json::accept(fxagent::result_text(recorded))) std::abort();
  return 0;
}
