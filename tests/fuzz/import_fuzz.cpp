// Any bytes as a file of another program, in each format. Nothing may crash, and a config that
// comes out is right, goes into a spreadsheet, and comes back as it was.
#include <cstdint>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

#include "agent/config/config.h"
#include "agent/import/formats.h"
#include "agent/import/tag_csv.h"
#include "agent/import/text_encoding.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace fxagent;
  const std::string_view bytes(reinterpret_cast<const char*>(data), size);
  for (const ImportFormat& format : import_formats()) {
    const auto text = to_utf8(bytes, format.legacy);
    if (!text) continue;
    auto imported = format.read(*text, {});
    if (!imported) continue;
    const ImportOutcome outcome = finish(*std::move(imported));
    if (outcome.config.empty()) continue;
    if (!parse_config(outcome.config)) std::abort();
    auto again = import_tag_csv(export_csv(outcome.config), {});
    if (!again) std::abort();
    const ImportOutcome back = finish(*std::move(again));
    if (nlohmann::json::parse(back.config) != nlohmann::json::parse(outcome.config)) std::abort();
  }
  return 0;
}
