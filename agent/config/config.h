// The config file as plain structs: everything checked, every name resolved, nothing left to parse.
#pragma once

#include <chrono>
#include <compare>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "agent/config/keys.h"
#include "agent/config/shared_list.h"
#include "agent/config/shared_vector.h"
#include "protocol/catalog.h"
#include "protocol/codec.h"
#include "protocol/point.h"
#include "protocol/short_text.h"

namespace fxagent {

/// How the kernel switches a two-wire port between sending and listening, by its RTS line.
struct Rs485 {
  /// RTS is high while the port sends and low else; false: the other way round.
  bool rts_on_send = config_key("links[].serial.rs485.rts_on_send").flag();
  std::chrono::milliseconds delay_before{
      config_key("links[].serial.rs485.delay_before_ms").number()};
  std::chrono::milliseconds delay_after{config_key("links[].serial.rs485.delay_after_ms").number()};
  friend bool operator==(const Rs485&, const Rs485&) = default;
};

struct SerialSettings {
  std::string path;
  int baud = LineDefaults{}.baud;
  int data_bits = LineDefaults{}.data_bits;
  Parity parity = LineDefaults{}.parity;
  int stop_bits = LineDefaults{}.stop_bits;
  std::optional<Rs485> rs485{};  ///< nothing: the direction is the adapter's own affair
  friend bool operator==(const SerialSettings&, const SerialSettings&) = default;
};

struct TcpSettings {
  std::string host;
  std::uint16_t port = 0;
  int line_baud = 0;  ///< of the serial line behind it; 0: unknown, or there is none
  friend bool operator==(const TcpSettings&, const TcpSettings&) = default;
};

struct UdpSettings {
  std::string host;
  std::uint16_t port = 0;
  std::uint16_t local_port = 0;  ///< that the agent asks from; 0: any that is free
  friend bool operator==(const UdpSettings&, const UdpSettings&) = default;
};

inline constexpr std::chrono::milliseconds kLongestListening{5000};

struct LinkConfig {
  std::string name;  ///< empty: a vacant place, see Config
  std::variant<SerialSettings, TcpSettings, UdpSettings> channel;
  /// One character on the wire, start, parity and stop bits counted; 0 where the speed is unknown
  /// (tcp without line_baud, udp).
  std::chrono::nanoseconds char_time{0};
  /// How long the line listens before the first question of each session, so that no answer to an
  /// earlier one is taken for its own: as long as the latest answer may take, twice the longest
  /// timeout_ms of its devices and kLongestListening at most. 0 where answers have numbers, or
  /// go to another connection, or to another port of UDP.
  std::chrono::milliseconds listening{0};
  /// Of the line, that polls keep while commands flood it; 0 … 0.9
  double poll_share = static_cast<double>(config_key("links[].poll_share_percent").number()) / 100;

  bool is_vacant() const { return name.empty(); }
  friend bool operator==(const LinkConfig&, const LinkConfig&) = default;
};

struct GroupConfig {
  std::string name;
  /// 0: as fast as the line allows.
  std::chrono::milliseconds interval{config_key("devices[].groups[].interval_ms").number()};
  bool on_change = config_key("devices[].groups[].publish").index() == 1;
  std::chrono::seconds max_silent{config_key("devices[].groups[].max_silent_s").number()};
  friend bool operator==(const GroupConfig&, const GroupConfig&) = default;
};

/// In engineering units.
struct TagLimits {
  std::optional<double> min{};
  std::optional<double> max{};
  std::optional<double> deadband{};
  friend auto operator<=>(const TagLimits&, const TagLimits&) = default;
};

/// Labels of values in engineering units, sorted by value. Of a bool 0 is false and 1 is true.
using TagStates = std::vector<std::pair<std::int64_t, std::string>>;

/// What the values of a tag mean to people. A plant has few different ones, unless its tags have
/// descriptions.
struct TagUnits {
  std::string unit{};
  TagLimits limits{};
  std::string description{};
  TagStates states{};
  friend auto operator<=>(const TagUnits&, const TagUnits&) = default;
};
/// The empty one, which all tags share that have nothing of it.
const std::shared_ptr<const TagUnits>& no_units();

/// A config may have 100,000 of them: what most leave out is not in here.
struct TagConfig {
  ShortText name;
  Point point;
  std::uint32_t group = 0;  ///< index in DeviceConfig::groups
  bool writable = config_key("devices[].tags[].access").index() == 1;  ///< access: read_write
  /// Shared by the tags that have the same; never null.
  std::shared_ptr<const TagUnits> units = no_units();
  friend bool operator==(const TagConfig& a, const TagConfig& b);
};

struct CommandRules {
  std::vector<Span>
      allow;  ///< sorted, neighbours merged, so that a covered write lies in one of them
  bool allow_run_stop = config_key("devices[].commands.allow_run_stop").flag();
  std::chrono::seconds default_expiry{config_key("devices[].commands.default_expiry_s").number()};
  std::chrono::seconds max_expiry{config_key("devices[].commands.max_expiry_s").number()};
  bool verify = config_key("devices[].commands.verify").flag();
  /// Commands that may wait on this device.
  std::size_t queue = static_cast<std::size_t>(config_key("devices[].commands.queue").number());
  friend bool operator==(const CommandRules&, const CommandRules&) = default;
};

/// In the order of the catalogue, whose default is the first.
enum class EnquirePolicy : std::uint8_t { open, always, never };

/// On UDP, where answers have no numbers, the next question waits for so long: what a network
/// brings twice comes twice within this time, nearly always.
inline constexpr std::chrono::milliseconds kQuietBetweenDatagrams{10};

struct DeviceConfig {
  std::string name;        ///< empty: a vacant place, see Config
  std::uint32_t link = 0;  ///< index in Config::links
  const ProtocolInfo* protocol = nullptr;
  /// Shared by this config, the workers, and the devices of the same options; const, so any thread.
  std::shared_ptr<const Codec> codec;
  std::shared_ptr<const Options> options;  ///< what the codec was made of, shared like it
  /// Allowed beyond the expected line time.
  std::chrono::milliseconds timeout{config_key("devices[].timeout_ms").number()};
  int retries = static_cast<int>(config_key("devices[].retries").number());
  /// Silence before a request, that which UDP asks for included: kQuietBetweenDatagrams.
  std::chrono::milliseconds gap{config_key("devices[].gap_ms").number()};
  /// The device's own time, for plan and bound.
  std::chrono::milliseconds turnaround{config_key("devices[].turnaround_ms").number()};
  bool echo = config_key("devices[].echo").flag();  ///< the line returns what is sent
  std::uint32_t max_block_bytes = 0;                ///< 0: the protocol's own limit
  EnquirePolicy enquire{};
  std::vector<GroupConfig> groups;
  SharedVector<TagConfig> tags;  ///< shared by the devices that have the same
  CommandRules commands;

  bool is_vacant() const { return name.empty(); }
  /// Whether the two say the same; codecs are equal where they are made of the same options.
  friend bool operator==(const DeviceConfig& a, const DeviceConfig& b);
};

struct TlsSettings {
  std::string ca_file;
  std::string cert_file;
  std::string key_file;
  friend bool operator==(const TlsSettings&, const TlsSettings&) = default;
};

struct MqttConfig {
  std::vector<std::string> servers;  ///< mqtt://host:port or mqtts://host:port, tried from the top
  /// 5, or 4 for MQTT 3.1.1
  int version = config_key("mqtt.version").index() == 0 ? 5 : 4;
  std::string client_id;
  std::string username;
  std::string password_file;
  std::string password_env;  ///< name of an environment variable; the file wins where both are set
  std::string password;      ///< the password itself; the two above are empty then
  std::optional<TlsSettings> tls;
  std::chrono::seconds keep_alive{config_key("mqtt.keep_alive_s").number()};
  /// Of data topics.
  int qos = static_cast<int>(config_key("mqtt.qos").number());
  friend bool operator==(const MqttConfig&, const MqttConfig&) = default;
};

struct StoreConfig {
  std::string path;  ///< empty: no store
  std::uint64_t max_bytes = static_cast<std::uint64_t>(config_key("store.max_bytes").number());
  std::chrono::hours max_age{config_key("store.max_age_h").number()};
  bool sync_always = config_key("store.sync").index() == 1;
  std::uint64_t audit_max_bytes =
      static_cast<std::uint64_t>(config_key("store.audit_max_bytes").number());
  std::chrono::hours audit_max_age{config_key("store.audit_max_age_h").number()};
  friend bool operator==(const StoreConfig&, const StoreConfig&) = default;
};

/// Where metrics are served.
struct MetricsConfig {
  std::string address;     ///< IPv4 or IPv6, without brackets; empty: at `unix_path`
  std::uint16_t port = 0;  ///< 0: any that is free
  std::string unix_path;   ///< absolute
  friend bool operator==(const MetricsConfig&, const MetricsConfig&) = default;
};

/// One `commands.allow:` entry of `agent.remote_allow`.
struct RemoteRange {
  /// nullptr: the entry is for devices of the local file. Otherwise it is for every device of this
  /// protocol and model.
  const ProtocolInfo* protocol = nullptr;
  std::string model{};  ///< empty if `protocol` is nullptr or has no models
  std::string range{};  ///< as AddressSpace::parse_range() reads it
  friend bool operator==(const RemoteRange&, const RemoteRange&) = default;
};

/// What may come over MQTT, on {base}/config/desired.
struct RemoteLimits {
  bool enabled = config_key("agent.remote_config").flag();
  /// A config that cannot be kept on disk is taken over all the same.
  bool without_disk = config_key("agent.remote_without_disk").flag();
  bool links = true;
  bool devices = true;   ///< and `templates`
  bool servers = false;  ///< mqtt.servers
  bool run_stop = false;
  /// Addresses that commands may touch in addition to those of the local file.
  std::vector<RemoteRange> allow{};
  friend bool operator==(const RemoteLimits&, const RemoteLimits&) = default;
};

/// A document of {base}/config/desired that is larger is refused unread.
inline constexpr std::size_t kMaxDesiredBytes = std::size_t{1} << 20;

/// As a file says it, or as it is in force in a running agent, which a reload has changed: there a
/// link or device that did not change keeps its index, and where one was taken out its place is
/// vacant until another one takes it (config_difference.h).
struct Config {
  std::string id;
  std::string root;
  RemoteLimits remote;
  MqttConfig mqtt;
  StoreConfig store;
  std::optional<MetricsConfig> metrics;  ///< nullopt: none are served
  SharedVector<LinkConfig> links;
  /// A reload shares those that did not change with the config before it.
  SharedList<DeviceConfig> devices;
  std::vector<std::string> warnings;  ///< what is allowed and still worth a word
  std::string hash;                   ///< of the text: the first 16 digits of its SHA-256

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

/// The environment of the process.
std::optional<std::string> process_environment(std::string_view name);

/// Whether others than its owner can read the config file: then no password may stand in it, unless
/// `allow_plain_secret` is set.
enum class FilePrivacy : std::uint8_t { shared, owner_only };

/// What stands in the file, up to a little more than a config may have.
tl::expected<std::string, std::vector<ConfigError>> read_config_file(const std::string& path);

/// Reads and checks a config file; every error at once, in the order of the file. `${NAME}` in a
/// string is taken from the environment of the process; `$${NAME}` stands for a plain `${NAME}`.
/// Paths of `mqtt` and `store` that are relative are taken from the directory of the file. Never
/// throws.
tl::expected<Config, std::vector<ConfigError>> load_config(const std::string& path);
/// The same on a text that stands for what is in the file: of its rights and its directory.
tl::expected<Config, std::vector<ConfigError>> config_of_file(const std::string& path,
                                                              std::string_view text);
/// The same on a text already in memory; paths are left as they stand. Depends on its arguments
/// alone.
tl::expected<Config, std::vector<ConfigError>> parse_config(
    std::string_view text, const Environment& environment,
    FilePrivacy privacy = FilePrivacy::shared);
/// The same with the environment of the process.
tl::expected<Config, std::vector<ConfigError>> parse_config(std::string_view text);

/// What the config names and this machine lacks: certificates and password files that cannot be
/// read, a password variable that is not set, a store that cannot be written. Pointers are those of
/// the file; lines are 0. Changes nothing on disk. Of serial ports: unavailable_ports() of
/// serial_ports.h.
std::vector<ConfigError> check_files(const Config& config);

/// Password and key files that others can read than those who must: everybody, or the group of a
/// file that is this user's own. Credentials that systemd hands over are not looked at: their
/// access lists show as rights of a group. Pointers and lines as above.
std::vector<ConfigError> exposed_secrets(const Config& config);

}  // namespace fxagent
