#include "agent/import/formats.h"

#include <array>

namespace fxagent {

std::span<const ImportFormat> import_formats() {
  // Formats with an unmistakable header come first: the header word of GX also occurs in cells of
  // other formats.
  static constexpr std::array kFormats{
      ImportFormat{"kepware", "Tags of KEPServerEX (CSV)", "WINDOWS-1252", is_kepware,
                   import_kepware},
      ImportFormat{"csv", "Tags, as export --csv writes them", "WINDOWS-1252", is_tag_csv,
                   import_tag_csv},
      ImportFormat{"gx", "Device comments of GX Developer, GX Works2 or GX Works3 (CSV)", "CP932",
                   is_gx_comments, import_gx_comments},
      ImportFormat{"neuron", "Nodes of Neuron (JSON), or its sheet of tags (CSV)", "WINDOWS-1252",
                   is_neuron, import_neuron},
      ImportFormat{"thingsboard", "modbus.json of the ThingsBoard gateway", "WINDOWS-1252",
                   is_thingsboard, import_thingsboard},
      ImportFormat{"telegraf", "inputs.modbus of Telegraf (TOML)", "WINDOWS-1252", is_telegraf,
                   import_telegraf}};
  return kFormats;
}

}  // namespace fxagent
