// Imports arbitrary bytes as a file of another program, in each format. Nothing may crash. A
// resulting config must be valid and survive a round trip through a spreadsheet unchanged.
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

#include "agent/config/loader.h"
#include "agent/config/source.h"
#include "agent/import/formats.h"
#include "agent/process/this_process.h"

namespace {

/// Aborts with the violated property and the texts that show it.
void fail(const char* what, const std::string& made, const std::string& other = {}) {
  std::fprintf(stderr, "%s\n%s\n%s\n", what, made.c_str(), other.c_str());
  std::abort();
}

}  // namespace

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
    if (!parse_config(outcome.config, process_environment, FilePrivacy::owner_only))
      fail("the config is not right", outcome.config);
    const std::string csv = export_csv(outcome.config);
    auto again = import_tag_csv(csv, {});
    if (!again) fail("it is not read as CSV", outcome.config, csv);
    const ImportOutcome back = finish(*std::move(again));
    if (nlohmann::json::parse(back.config, nullptr, false) != nlohmann::json::parse(outcome.config))
      fail("another config comes back", outcome.config, csv + back.config);
  }
  return 0;
}
