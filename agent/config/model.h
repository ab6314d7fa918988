// The config file as plain structs: checked and parsed, with all names resolved.
#pragma once

#include <chrono>
#include <compare>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "agent/config/keys.h"
#include "agent/config/shared_list.h"
#include "protocol/catalog.h"
#include "protocol/codec.h"
#include "protocol/value/point.h"
#include "protocol/value/short_text.h"

namespace fxagent {

/// Direction control of a two-wire port: the kernel switches between sending and receiving with
/// RTS.
struct Rs485 {
  /// True: RTS is high while the port sends and low otherwise. False: the reverse.
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
  std::optional<Rs485> rs485{};  ///< nullopt: the adapter switches the direction on its own
  friend bool operator==(const SerialSettings&, const SerialSettings&) = default;
};

struct TcpSettings {
  std::string host;
  std::uint16_t port = 0;
  int line_baud = 0;  ///< speed of the serial line behind it; 0: unknown or none
  friend bool operator==(const TcpSettings&, const TcpSettings&) = default;
};

struct UdpSettings {
  std::string host;
  std::uint16_t port = 0;
  std::uint16_t local_port = 0;  ///< source port of requests; 0: any free port
  friend bool operator==(const UdpSettings&, const UdpSettings&) = default;
};

/// Upper limit of LinkConfig::listening.
inline constexpr std::chrono::milliseconds kLongestListening{5000};

struct LinkConfig {
  std::string name;  ///< empty: a vacant place, see Config
  std::variant<SerialSettings, TcpSettings, UdpSettings> channel;
  /// Time of one character on the wire, with start, parity and stop bits; 0 if the speed is unknown
  /// (tcp without line_baud, udp).
  std::chrono::nanoseconds char_time{0};
  /// Time that the link listens before the first request of each session, so that it does not
  /// mistake a late reply to an earlier request for the reply to this one: twice the longest
  /// timeout of its devices, at most kLongestListening. 0 if replies carry numbers, or if a late
  /// reply goes to another connection or UDP port.
  std::chrono::milliseconds listening{0};
  /// Share of line time reserved for polls while commands flood the line; 0 … 0.9.
  double poll_share = static_cast<double>(config_key("links[].poll_share_percent").number()) / 100;
  bool allow_yield = false;  ///< a command may free the port for another program

  bool is_vacant() const { return name.empty(); }
  friend bool operator==(const LinkConfig&, const LinkConfig&) = default;
};
/// Returns the time of one character: start bit, data bits, parity bit, stop bits.
std::chrono::nanoseconds char_time_of(const SerialSettings& line);
/// Returns the path of the serial port, or "host:port".
std::string endpoint_of(const LinkConfig& link);
/// Returns "serial /dev/ttyUSB0 9600 7E1", "tcp 10.0.0.7:502" or "udp 10.0.0.7:5007".
std::string channel_text(const LinkConfig& link);

struct GroupConfig {
  std::string name;
  /// 0: as fast as the line allows.
  std::chrono::milliseconds interval{config_key("devices[].groups[].interval_ms").number()};
  bool on_change = config_key("devices[].groups[].publish").index() == 1;
  std::chrono::seconds max_silent{config_key("devices[].groups[].max_silent_s").number()};
  friend bool operator==(const GroupConfig&, const GroupConfig&) = default;
};

/// Limits in engineering units.
struct TagLimits {
  std::optional<double> min{};
  std::optional<double> max{};
  std::optional<double> deadband{};
  friend auto operator<=>(const TagLimits&, const TagLimits&) = default;
};

/// Labels of values in engineering units, sorted by value. For a bool, 0 is false and 1 is true.
using TagStates = std::vector<std::pair<std::int64_t, std::string>>;

/// Meaning of a tag's values for people. Many tags have equal ones, unless they have descriptions.
struct TagUnits {
  std::string unit{};
  TagLimits limits{};
  std::string description{};
  TagStates states{};
  friend auto operator<=>(const TagUnits&, const TagUnits&) = default;
};
/// Returns the empty TagUnits, shared by all tags without any of these settings.
const std::shared_ptr<const TagUnits>& no_units();

/// A config may have 100,000 tags: settings that most tags lack are in TagUnits.
struct TagConfig {
  ShortText name;
  Point point;
  std::uint32_t group = 0;  ///< index in DeviceConfig::groups
  bool writable = config_key("devices[].tags[].access").index() == 1;  ///< access: read_write
  /// Owners: all tags with equal units. Never nullptr.
  std::shared_ptr<const TagUnits> units = no_units();
  friend bool operator==(const TagConfig& a, const TagConfig& b);
};

struct CommandRules {
  std::vector<Span> allow;  ///< sorted, neighbours merged: a write is allowed if one span covers it
  bool allow_run_stop = config_key("devices[].commands.allow_run_stop").flag();
  std::chrono::seconds default_expiry{config_key("devices[].commands.default_expiry_s").number()};
  std::chrono::seconds max_expiry{config_key("devices[].commands.max_expiry_s").number()};
  bool verify = config_key("devices[].commands.verify").flag();
  /// Most commands that wait for this device.
  std::size_t queue = static_cast<std::size_t>(config_key("devices[].commands.queue").number());
  friend bool operator==(const CommandRules&, const CommandRules&) = default;
};

/// In the order of the catalogue's choices. The first is the default.
enum class EnquirePolicy : std::uint8_t { open, always, never };

/// Silence before a UDP request if replies carry no numbers. A duplicate datagram of the network
/// nearly always arrives within this time.
inline constexpr std::chrono::milliseconds kQuietBetweenDatagrams{10};

struct DeviceConfig {
  std::string name;        ///< empty: a vacant place, see Config
  std::uint32_t link = 0;  ///< index in Config::links
  const ProtocolInfo* protocol = nullptr;
  /// Owners: this config, the workers, and devices with equal options. Const, so any thread.
  std::shared_ptr<const Codec> codec;
  std::shared_ptr<const Options> options;  ///< the codec's options; owners as for `codec`
  /// Time allowed for a reply in addition to the expected line time.
  std::chrono::milliseconds timeout{config_key("devices[].timeout_ms").number()};
  int retries = static_cast<int>(config_key("devices[].retries").number());
  /// Silence before a request; at least kQuietBetweenDatagrams on UDP if replies carry no numbers.
  std::chrono::milliseconds gap{config_key("devices[].gap_ms").number()};
  /// Expected response time of the device, for planning and for the bound of commands.
  std::chrono::milliseconds turnaround{config_key("devices[].turnaround_ms").number()};
  bool echo = config_key("devices[].echo").flag();  ///< the line returns every byte sent
  std::uint32_t max_block_bytes = 0;                ///< 0: the protocol's own limit
  EnquirePolicy enquire{};
  std::vector<GroupConfig> groups;
  SharedVector<TagConfig> tags;  ///< shared by devices with equal tags
  CommandRules commands;

  bool is_vacant() const { return name.empty(); }
  /// True if the settings are equal. Codecs are equal if their options are.
  friend bool operator==(const DeviceConfig& a, const DeviceConfig& b);
};

struct TlsSettings {
  std::string ca_file;
  std::string cert_file;
  std::string key_file;
  friend bool operator==(const TlsSettings&, const TlsSettings&) = default;
};

struct MqttConfig {
  std::vector<std::string> servers;  ///< mqtt://host:port or mqtts://host:port, tried in order
  /// 5, or 4 for MQTT 3.1.1.
  int version = config_key("mqtt.version").index() == 0 ? 5 : 4;
  std::string client_id;
  std::string username;
  std::string password_file;
  std::string password_env;  ///< name of an environment variable; password_file takes precedence
  std::string password;      ///< the password itself; the two above are empty then
  std::optional<TlsSettings> tls;
  std::chrono::seconds keep_alive{config_key("mqtt.keep_alive_s").number()};
  /// QoS of data topics.
  int qos = static_cast<int>(config_key("mqtt.qos").number());
  /// Random delay after a loss, at most.
  std::chrono::seconds reconnect_spread{config_key("mqtt.reconnect_spread_s").number()};
  friend bool operator==(const MqttConfig&, const MqttConfig&) = default;
};

struct Config;

/// One of the brokers beside that of `mqtt`.
struct BrokerConfig {
  std::string name;
  MqttConfig mqtt;
  bool commands = config_key("brokers[].commands").flag();  ///< it may send commands
  friend bool operator==(const BrokerConfig&, const BrokerConfig&) = default;
};

/// A form in which values are published. The agent's own session has `json`; every other profile
/// has an MQTT session of its own.
struct ProfileConfig {
  /// In the order of the catalogue's choices. `sparkplug_commands` is not a choice: the key
  /// `commands` of a `sparkplug` adds it, with the same group, node and host.
  enum class Kind : std::uint8_t {
    json,
    plain,
    sparkplug,
    homeassistant,
    thingsboard,
    sparkplug_commands
  };
  Kind kind = Kind::json;
  std::string broker;           ///< name; empty: that of `mqtt`
  std::string topic;            ///< plain: with {device}, {group} and {tag} to replace
  std::string group{}, node{};  ///< sparkplug: group id and edge node id
  std::string host{};           ///< sparkplug: id of the primary host; empty: none
  std::string prefix{};         ///< homeassistant: first level of the discovery topics
  std::chrono::seconds deadline{config_key("profiles[].deadline_s").number()};  ///< thingsboard
  bool old_state = false;  ///< sparkplug: the host's state is in the form before 3.0
  friend bool operator==(const ProfileConfig&, const ProfileConfig&) = default;
};
/// Returns the broker with this name; nullptr if none of `brokers` has it.
const BrokerConfig* broker_named(const Config& config, const std::string& name);
/// Returns the settings of the broker with this name; those of `mqtt` if it is empty or unknown.
const MqttConfig& broker_of(const Config& config, const std::string& name);
/// Returns the settings of every broker, with their place in the file: "/mqtt", "/brokers/0" …
std::vector<std::pair<std::string, const MqttConfig*>> brokers_of(const Config& config);
/// Returns the kind of the profile, as in its name.
std::string_view kind_of(const ProfileConfig& profile);
/// Returns the name of the profile, unique in a config: "plain", or "plain@cloud" for a broker.
std::string name_of(const ProfileConfig& profile);

struct StoreConfig {
  std::string path;            ///< empty: no store
  bool keeps_commands = true;  ///< false: it is of a profile, and has samples only
  std::uint64_t max_bytes = static_cast<std::uint64_t>(config_key("store.max_bytes").number());
  std::chrono::hours max_age{config_key("store.max_age_h").number()};
  bool sync_always = config_key("store.sync").index() == 1;
  std::uint64_t audit_max_bytes =
      static_cast<std::uint64_t>(config_key("store.audit_max_bytes").number());
  std::chrono::hours audit_max_age{config_key("store.audit_max_age_h").number()};
  friend bool operator==(const StoreConfig&, const StoreConfig&) = default;
};

/// Address of the HTTP server: `http.listen`, or `metrics.listen` without the page.
struct HttpConfig {
  std::string address;             ///< IPv4 or IPv6, without brackets; empty: use `unix_path`
  std::uint16_t port = 0;          ///< 0: any free port
  std::string unix_path;           ///< absolute
  bool page = false;               ///< serves the page and its data, too
  std::vector<std::string> hosts;  ///< more names by which a browser may call the page
  std::string token_file;          ///< who may send commands from the page; empty: nobody
  friend bool operator==(const HttpConfig&, const HttpConfig&) = default;
};

struct RecorderConfig {
  std::string path;                           ///< directory of the recordings
  std::optional<std::uint64_t> link_bytes{};  ///< nullopt: as ring_bytes() says
  std::size_t files = static_cast<std::size_t>(config_key("recorder.files").number());
  std::uint64_t max_bytes = static_cast<std::uint64_t>(config_key("recorder.max_bytes").number());
  friend bool operator==(const RecorderConfig&, const RecorderConfig&) = default;
};
/// Returns the memory of each link's frames, in bytes, with so many links.
std::size_t ring_bytes(const RecorderConfig& recorder, std::size_t links);

/// Standby pair: this gateway is one of two at the same devices.
struct PairConfig {
  std::string member;  ///< name of this gateway
  std::chrono::milliseconds quiet{config_key("pair.quiet_ms").number()};
  friend bool operator==(const PairConfig&, const PairConfig&) = default;
};

/// One `commands.allow:` entry of `agent.remote_allow`.
struct RemoteRange {
  /// nullptr: the entry is for devices of the local file. Otherwise it is for every device of this
  /// protocol and model.
  const ProtocolInfo* protocol = nullptr;
  std::string model{};  ///< empty if `protocol` is nullptr or has no models
  std::string range{};  ///< as AddressSpace::parse_range() reads it
  Span span{};          ///< the same for that model; only if `protocol` is set
  friend bool operator==(const RemoteRange&, const RemoteRange&) = default;
};

/// Changes that a remote config, received on {base}/config/desired, may make.
struct RemoteLimits {
  bool enabled = config_key("agent.remote_config").flag();
  /// Apply a config even if it cannot be saved on disk.
  bool without_disk = config_key("agent.remote_without_disk").flag();
  bool links = true;
  bool devices = true;   ///< and `templates`
  bool servers = false;  ///< mqtt.servers
  bool run_stop = false;
  /// Addresses that commands may touch in addition to those of the local file.
  std::vector<RemoteRange> allow{};
  friend bool operator==(const RemoteLimits&, const RemoteLimits&) = default;
};

/// Largest document of {base}/config/desired in bytes. A larger one is rejected unread.
inline constexpr std::size_t kMaxDesiredBytes = std::size_t{1} << 20;

/// A config as read from a file, or as in force in a running agent after reloads. A reload keeps
/// the index of every link or device that goes on. The place of a removed one is vacant until a new
/// one takes it (config_difference.h).
struct Config {
  std::string id;
  std::string root;
  RemoteLimits remote;
  MqttConfig mqtt;
  std::vector<BrokerConfig> brokers;
  std::vector<ProfileConfig> profiles;  ///< without the agent's own, `json`
  StoreConfig store;
  std::optional<HttpConfig> http;          ///< nullopt: the agent has no HTTP server
  std::optional<RecorderConfig> recorder;  ///< nullopt: the agent records no frames
  std::optional<PairConfig> pair;          ///< nullopt: the agent works alone
  SharedVector<LinkConfig> links;
  /// After a reload, unchanged devices are shared with the previous config.
  SharedList<DeviceConfig> devices;
  std::vector<std::string> warnings;  ///< settings that are allowed and probably a mistake
  std::string hash;                   ///< of the text: the first 16 digits of its SHA-256

  /// Returns "{root}/{id}".
  std::string base_topic() const { return root + "/" + id; }
};

}  // namespace fxagent
