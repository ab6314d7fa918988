// Bodies of the audit's records of commands and remote configs. agent/store/audit_chain.h ties
// records together and explains them. Pure functions, any thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "agent/commands/journal.h"
#include "agent/handover/command_message.h"

namespace fxagent::audit {

/// Topic in the receipt of a command that came from the command line: no broker knows of it.
inline constexpr std::string_view kCommandLine = "command line";

/// Receipt of a command. `number` is its command number, which rises across restarts.
struct Receipt {
  std::uint64_t number = 0;
  std::string device;
  std::string topic;
  std::string payload{};  ///< at least its beginning
  std::size_t payload_bytes = 0;
  std::string by{};  ///< sender as named by the command, not verified; empty: none
  bool retained = false;
  std::int64_t received_ms = 0;
};

/// Bytes kept of a payload, and of `by`.
inline constexpr std::size_t kPayloadKept = 256;
/// Bytes. A longer result loses its values: they come from the sender, and may be 64 KiB.
inline constexpr std::size_t kResultKept = 8192;

// Bodies for seal(). `result_text` comes from result_text().
std::string answered(const Receipt& receipt, std::string_view result_text, std::int64_t now_ms);
std::string admitted(const Receipt& receipt, std::string_view id, std::string_view op,
                     std::int64_t now_ms);
/// Same for a command that the other gateway of a pair has announced on `topic`.
std::string announced(const JournalEntry& entry, std::string_view topic, std::int64_t now_ms);
std::string result(std::uint64_t number, std::string_view device, std::string_view result_text,
                   const FrameTrace& frames, std::int64_t now_ms);
std::string delivery(std::uint64_t number, std::string_view device, std::string_view id,
                     bool acknowledged, std::int64_t now_ms);

/// Outcome of a remote config. `version` and `by` come from the sender, and `errors` may quote it.
struct ConfigReceipt {
  std::string version;  ///< empty: not readable, or none
  std::string by;
  std::string state;         ///< as reported
  std::string desired_hash;  ///< of the document; empty: it was withdrawn
  std::string hash;          ///< of the config in force afterwards
  std::vector<std::string> errors;
  std::size_t errors_in_all = 0;  ///< as reported; `errors` may have fewer
};
/// Number of errors kept.
inline constexpr std::size_t kErrorsKept = 16;
std::string config(const ConfigReceipt& receipt, std::string_view topic, std::int64_t now_ms);

}  // namespace fxagent::audit
