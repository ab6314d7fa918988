// The config file as plain structs: everything checked, every name resolved, nothing left to parse.
#pragma once

#include <boost/flyweight.hpp>
#include <boost/functional/hash.hpp>
#include <chrono>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "protocol/catalog.h"
#include "protocol/codec.h"
#include "protocol/point.h"

namespace fxagent {

enum class Parity : std::uint8_t { none, even, odd };

struct SerialSettings {
  std::string path;
  int baud = 9600;
  int data_bits = 7;
  Parity parity = Parity::even;
  int stop_bits = 1;
};

struct TcpSettings {
  std::string host;
  std::uint16_t port = 0;
  int line_baud = 0;  ///< of the serial line behind it; 0: unknown, or there is none
};

struct LinkConfig {
  std::string name;
  std::variant<SerialSettings, TcpSettings> channel;
  /// One character on the wire, start, parity and stop bits counted; 0 where the speed is unknown
  /// (tcp without line_baud).
  std::chrono::nanoseconds char_time{0};
  double poll_share = 0.2;  ///< of the line, that polls keep while commands flood it; 0 … 0.9
};

struct GroupConfig {
  std::string name;
  std::chrono::milliseconds interval{1000};  ///< 0: as fast as the line allows
  bool on_change = false;
  std::chrono::seconds max_silent{60};
};

/// A text that many tags hold, once in memory: the names and units of 100,000 tags are few.
using SharedText = boost::flyweight<std::string>;

/// In engineering units.
struct TagLimits {
  std::optional<double> min{};
  std::optional<double> max{};
  std::optional<double> deadband{};
  friend bool operator==(const TagLimits&, const TagLimits&) = default;
};
inline std::size_t hash_value(const TagLimits& limits) {
  std::size_t seed = 0;
  for (const auto& limit : {limits.min, limits.max, limits.deadband})
    boost::hash_combine(seed, limit.value_or(std::numeric_limits<double>::max()));
  return seed;
}

struct TagConfig {
  SharedText name;
  Point point;
  SharedText unit;
  std::uint32_t group = 0;  ///< index in DeviceConfig::groups
  bool writable = false;    ///< access: read_write
  boost::flyweight<TagLimits> limits;
};

struct CommandRules {
  std::vector<Span>
      allow;  ///< sorted, neighbours merged, so that a covered write lies in one of them
  bool allow_run_stop = false;
  std::chrono::seconds default_expiry{10};
  std::chrono::seconds max_expiry{3600};
  bool verify = true;
  std::size_t queue = 64;  ///< commands that may wait on this device
};

enum class EnquirePolicy : std::uint8_t { open, always, never };

struct DeviceConfig {
  std::string name;
  std::uint32_t link = 0;  ///< index in Config::links
  const ProtocolInfo* protocol = nullptr;
  /// Shared by this config and the worker that reads the device; const, so any thread.
  std::shared_ptr<const Codec> codec;
  Options options;                          ///< what the codec was made of
  std::chrono::milliseconds timeout{1000};  ///< allowed beyond the expected line time
  int retries = 2;
  std::chrono::milliseconds gap{0};          ///< silence before a request
  std::chrono::milliseconds turnaround{30};  ///< the device's own time, for plan and bound
  bool echo = false;                         ///< the line returns what is sent
  std::uint32_t max_block_bytes = 0;         ///< 0: the protocol's own limit
  EnquirePolicy enquire = EnquirePolicy::open;
  std::vector<GroupConfig> groups;
  std::vector<TagConfig> tags;
  CommandRules commands;
};

struct TlsSettings {
  std::string ca_file;
  std::string cert_file;
  std::string key_file;
};

struct MqttConfig {
  std::vector<std::string> servers;  ///< mqtt://host:port or mqtts://host:port, tried from the top
  int version = 5;                   ///< 5, or 4 for MQTT 3.1.1
  std::string client_id;
  std::string username;
  std::string password_file;
  std::string password_env;  ///< name of an environment variable; the file wins where both are set
  std::string password;      ///< the password itself; the two above are empty then
  std::optional<TlsSettings> tls;
  std::chrono::seconds keep_alive{30};
  int qos = 1;  ///< of data topics
};

struct StoreConfig {
  std::string path;  ///< empty: no store
  std::uint64_t max_bytes = 268435456;
  std::chrono::hours max_age{168};
  bool sync_always = false;
  std::uint64_t audit_max_bytes = 67108864;
  std::chrono::hours audit_max_age{8760};
};

struct Config {
  std::string id;
  std::string root;
  MqttConfig mqtt;
  StoreConfig store;
  std::vector<LinkConfig> links;
  std::vector<DeviceConfig> devices;
  std::vector<std::string> warnings;  ///< what is allowed and still worth a word

  /// "{root}/{id}"
  std::string base_topic() const { return root + "/" + id; }
};

struct ConfigError {
  std::string pointer;  ///< JSON pointer: "/devices/0/tags/3/address"
  int line = 0;         ///< 1-based; 0 where there is no text to point at
  std::string text;     ///< what is wrong, and the cure
};

/// "agent.json:12: /devices/0/tags/3/address: X8 is not octal …"
std::string to_string(const ConfigError& error, std::string_view file);

/// Where `${NAME}` comes from: the value of a variable, nullopt where it is not set.
using Environment = std::function<std::optional<std::string>(std::string_view name)>;

/// Whether others than its owner can read the config file: then no password may stand in it, unless
/// `allow_plain_secret` is set.
enum class FilePrivacy : std::uint8_t { shared, owner_only };

/// Reads and checks a config file; every error at once, in the order of the file. `${NAME}` in a
/// string is taken from the environment of the process; `$${NAME}` stands for a plain `${NAME}`.
/// Paths of `mqtt` and `store` that are relative are taken from the directory of the file. Never
/// throws.
tl::expected<Config, std::vector<ConfigError>> load_config(const std::string& path);
/// The same on a text already in memory; paths are left as they stand. Depends on its arguments
/// alone.
tl::expected<Config, std::vector<ConfigError>> parse_config(
    std::string_view text, const Environment& environment,
    FilePrivacy privacy = FilePrivacy::shared);
/// The same with the environment of the process.
tl::expected<Config, std::vector<ConfigError>> parse_config(std::string_view text);

/// What the config names and this machine lacks: certificates and password files that cannot be
/// read, a password variable that is not set, a serial port that is not there, a store that cannot
/// be written. Pointers are those of the file; lines are 0. Changes nothing on disk.
std::vector<ConfigError> check_files(const Config& config);

/// Password and key files that others can read than those who must: everybody, or the group of a
/// file that is this user's own. Credentials that systemd hands over are not looked at: their
/// access lists show as rights of a group. Pointers and lines as above.
std::vector<ConfigError> exposed_secrets(const Config& config);

}  // namespace fxagent
