// What the audit keeps of a command: bodies of records, which agent/store/audit_chain.h ties
// together and explains. Pure functions, any thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "agent/messages.h"

namespace fxagent::audit {

/// How a command came. `number` counts the commands of a store, across restarts; from 1.
struct Receipt {
  std::uint64_t number = 0;
  std::string device;
  std::string topic;
  std::string payload;  ///< its beginning at least
  std::size_t payload_bytes = 0;
  std::string by;  ///< who it says has sent it; nobody checks that here. Empty: nobody
  bool retained = false;
  std::int64_t received_ms = 0;
};

/// So much of a payload is kept, and of `by`.
inline constexpr std::size_t kPayloadKept = 256;
/// A result that is longer loses its values: they are the sender's, and may be 64 KiB.
inline constexpr std::size_t kResultKept = 8192;

// Bodies for seal(). `result_text` is what result_text() made.
std::string answered(const Receipt& receipt, std::string_view result_text, std::int64_t now_ms);
std::string admitted(const Receipt& receipt, std::string_view id, std::string_view op,
                     std::int64_t now_ms);
std::string result(std::uint64_t number, std::string_view device, std::string_view result_text,
                   const FrameTrace& frames, std::int64_t now_ms);
std::string delivery(std::uint64_t number, std::string_view device, std::string_view id,
                     bool acknowledged, std::int64_t now_ms);

/// What became of a remote config. Strings but the hashes are the sender's.
struct ConfigReceipt {
  std::string version;  ///< empty: it could not be read, or there is none
  std::string by;
  std::string state;         ///< as it was reported
  std::string desired_hash;  ///< of the document; empty: it was withdrawn
  std::string hash;          ///< of the config in force afterwards
  std::vector<std::string> errors;
};
/// So many of the errors are kept.
inline constexpr std::size_t kErrorsKept = 16;
std::string config(const ConfigReceipt& receipt, std::string_view topic, std::int64_t now_ms);

}  // namespace fxagent::audit
