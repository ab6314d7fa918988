// Every key of the config file, in one place: the loader refuses what is not here, and a test holds
// config/agent.schema.json to it. The keys of a protocol's devices come from the catalogue besides.
#pragma once

#include <array>
#include <string>
#include <string_view>
#include <vector>

namespace fxagent::config_keys {

using std::string_view_literals::operator""sv;

inline constexpr std::array top{"$schema"sv, "agent"sv, "mqtt"sv,
                                "store"sv,   "links"sv, "devices"sv};
inline constexpr std::array agent{"id"sv, "root"sv};
inline constexpr std::array mqtt{
    "servers"sv,       "version"sv,      "client_id"sv, "username"sv,
    "password_file"sv, "password_env"sv, "password"sv,  "allow_plain_secret"sv,
    "tls"sv,           "keep_alive_s"sv, "qos"sv};
inline constexpr std::array tls{"ca_file"sv, "cert_file"sv, "key_file"sv};
inline constexpr std::array store{"path"sv, "max_bytes"sv,       "max_age_h"sv,
                                  "sync"sv, "audit_max_bytes"sv, "audit_max_age_h"sv};
inline constexpr std::array link{"name"sv,      "serial"sv, "tcp"sv,       "line_baud"sv,
                                 "data_bits"sv, "parity"sv, "stop_bits"sv, "poll_share_percent"sv};
inline constexpr std::array serial{"path"sv, "baud"sv, "data_bits"sv, "parity"sv, "stop_bits"sv};
inline constexpr std::array tcp{"host"sv, "port"sv};
/// Of a device of any protocol.
inline constexpr std::array device{
    "name"sv,    "link"sv,   "protocol"sv, "model"sv,           "timeout_ms"sv,
    "retries"sv, "gap_ms"sv, "echo"sv,     "max_block_bytes"sv, "turnaround_ms"sv,
    "groups"sv,  "tags"sv,   "commands"sv};
inline constexpr std::array group{"name"sv, "interval_ms"sv, "publish"sv, "max_silent_s"sv};
inline constexpr std::array tag{"name"sv,       "address"sv,  "type"sv,   "length"sv, "count"sv,
                                "word_order"sv, "scale"sv,    "offset"sv, "unit"sv,   "min"sv,
                                "max"sv,        "deadband"sv, "group"sv,  "access"sv};
inline constexpr std::array commands{"allow"sv,        "allow_run_stop"sv, "default_expiry_s"sv,
                                     "max_expiry_s"sv, "verify"sv,         "queue"sv};

/// The keys of one object of the file.
struct ConfigObject {
  std::string place;  ///< "/devices/*/tags/*": the pointer, `*` for an array index; empty: the top
  std::string protocol;  ///< of the device that the object belongs to; empty: of any
  std::vector<std::string> keys;
};

/// Every object that the file can hold; the device object once for each protocol of the catalogue.
std::vector<ConfigObject> config_objects();

}  // namespace fxagent::config_keys
