// Any bytes from a file or a topic: the config loader and the command parser. Nothing may crash.
#include <cstdint>
#include <string_view>

#include "agent/config.h"
#include "agent/uplink/json.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  (void)fxagent::parse_config(text, [](std::string_view) { return std::nullopt; });
  (void)fxagent::json::command(text);
  return 0;
}
