// Table of every key of the config file, with type, range, default and meaning. The loader takes
// checks and defaults from it; cli/schema makes config/agent.schema.json and the tables of
// docs/config/keys.md from it. The keys that belong to one protocol come from the catalogue.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <string_view>
#include <variant>
#include <vector>

#include "protocol/catalog.h"
#include "protocol/value/point.h"

namespace fxagent {

/// As std::ranges::contains() of C++23.
template <class List, class Value, class Projection = std::identity>
constexpr bool contains(const List& list, const Value& value, Projection projection = {}) {
  return std::ranges::find(list, value, projection) != std::ranges::end(list);
}

struct ConfigKey {
  enum class Type : std::uint8_t {
    name,
    text,
    path,
    integer,
    number,
    boolean,
    choice,
    object,
    array,
    numbers  ///< a range, or a list of numbers or names
  };
  struct Limits {
    std::int64_t min = 0;  ///< integer: inclusive bounds
    std::int64_t max = 0;
    std::span<const std::string_view> words{};  ///< choice

    constexpr Limits() = default;
    constexpr Limits(std::int64_t least, std::int64_t most) : min(least), max(most) {}
    constexpr Limits(std::span<const std::string_view> list) : words(list) {}
    template <std::size_t N>
    constexpr Limits(const std::array<std::string_view, N>& list) : words(list) {}
  };
  struct None {};      ///< an absent key has no value
  struct Required {};  ///< the key must be present
  /// The value of an absent key comes from elsewhere; `text` describes where from.
  struct Rule {
    std::string_view text;
  };
  using Default = std::variant<None, Required, Rule, std::int64_t, bool, std::string_view>;

  std::string_view section;  ///< path of the object with the key: "devices[].groups[]"
  std::string_view name;     ///< "interval_ms"
  Type type = Type::text;
  Limits limits{};
  Default fallback{};
  std::string_view meaning;  ///< plain text with `code`, for people
  std::string_view since = "0.1";

  constexpr bool is(std::string_view path) const {
    if (section.empty()) return path == name;
    return path.size() == section.size() + 1 + name.size() && path.starts_with(section) &&
           path[section.size()] == '.' && path.ends_with(name);
  }
  constexpr bool is_number() const { return type == Type::integer || type == Type::number; }
  constexpr bool is_required() const { return std::holds_alternative<Required>(fallback); }
  constexpr std::int64_t number() const { return std::get<std::int64_t>(fallback); }
  constexpr bool flag() const { return std::get<bool>(fallback); }
  constexpr std::string_view word() const { return std::get<std::string_view>(fallback); }
  /// Returns the index of the default among the words.
  constexpr std::size_t index() const {
    const auto found = std::ranges::find(limits.words, word());
    return static_cast<std::size_t>(found - limits.words.begin());
  }
};

namespace config_keys {

using std::string_view_literals::operator""sv;
using enum ConfigKey::Type;
using Required = ConfigKey::Required;
using None = ConfigKey::None;
using Rule = ConfigKey::Rule;

inline constexpr std::array kVersions{"5"sv, "3.1.1"sv};
inline constexpr std::array kProfiles{"json"sv, "plain"sv, "sparkplug"sv, "homeassistant"sv,
                                      "thingsboard"sv};  // of ProfileConfig
inline constexpr std::array kSyncs{"offline"sv, "always"sv};
inline constexpr std::array kParities{"none"sv, "even"sv, "odd"sv};  // the order of Parity
inline constexpr std::array kPublish{"always"sv, "on_change"sv};
inline constexpr std::array kAccess{"read"sv, "read_write"sv};
inline constexpr std::array kTypes{"bool"sv,    "int16"sv, "uint16"sv, "int32"sv,
                                   "uint32"sv,  "int64"sv, "uint64"sv, "float32"sv,
                                   "float64"sv, "bcd16"sv, "bcd32"sv,  "string"sv};
/// Every protocol has the first four. See word_order_key().
inline constexpr std::array kWordOrders{"low_first"sv, "high_first"sv, "ABCD"sv,
                                        "CDAB"sv,      "BADC"sv,       "DCBA"sv};
inline constexpr ConfigKey::Limits kBaud{50, 4'000'000};
inline constexpr ConfigKey::Limits kBits{7, 8};
inline constexpr ConfigKey::Limits kStopBits{1, 2};
inline constexpr ConfigKey::Limits kBytes{65536, std::int64_t{1} << 53};
inline constexpr ConfigKey::Limits kRingBytes{4096, std::int64_t{16} << 20};
inline constexpr ConfigKey::Limits kMilliseconds{0, 60000};
inline constexpr ConfigKey::Limits kElements{1, 65535};
inline constexpr ConfigKey::Limits kExpiry{1, 604'800};  // a week
inline constexpr Rule kOfProtocol{"the protocol's"};

// clang-format off
/// All keys but those that each of the `brokers` shares with `mqtt`. The keys of one section must be
/// adjacent: config_section() returns them as one span.
inline constexpr auto kWritten = std::to_array<ConfigKey>({
    {"", "$schema", text, {}, None{}, "Schema for the editor; the agent does not follow it."},
    {"", "agent", object, {}, Required{}, "Identity of the agent, and remote config."},
    {"", "mqtt", object, {}, Required{}, "The brokers, with user and TLS."},
    {"", "profiles", array, {}, Rule{"`json` alone"},
     "Forms in which the values are published, each in an MQTT session of its own."},
    {"", "brokers", array, {}, None{}, "More brokers, to which `profiles` may publish. Each has `name`, `commands` and the keys of "
     "`mqtt`."},
    {"", "store", object, {}, None{},
     "Disk for samples while the broker is unreachable, and for ids of commands. Without it "
     "samples and ids are in memory, and a restart loses both."},
    {"", "http", object, {}, None{},
     "The page for people, with Prometheus' metrics and probes. Without it and `metrics` the "
     "agent does not listen."},
    {"", "metrics", object, {}, None{},
     "HTTP address for Prometheus and probes alone, without the page. Not together with `http`."},
    {"", "recorder", object, {}, None{},
     "Flight recorder: the newest frames of each link, written to disk at an anomaly or when "
     "asked. Without it the agent records no frames."},
    {"", "pair", object, {}, None{},
     "Standby pair: two gateways at the same devices, of which one is active. Without it the agent "
     "works alone."},
    {"", "links", array, {}, Required{},
     "Connections to the devices: serial ports, TCP connections and UDP ports."},
    {"", "templates", object, {}, None{},
     "Common parts of many devices: a name for each, with keys of a device."},
    {"", "devices", array, {}, Required{}, "The devices and their tags."},

    {"agent", "id", name, {}, Required{},
     "Last level of `{root}/{id}`. All topics of the agent are below it."},
    {"agent", "root", text, {}, "fx",
     "Levels before the id, at most 256 bytes. Wildcards and empty levels are not allowed. Nor "
     "is `/` at either end or `$` at the beginning."},
    {"agent", "remote_config", boolean, {}, false,
     "True if a config may arrive over MQTT, on `{root}/{id}/config/desired`, within the limits "
     "of `remote_allow`."},
    {"agent", "remote_allow", array, {}, Rule{"`links` and `devices`"},
     "Parts that a remote config may set: `links`, `devices` (with `templates`), `mqtt.servers`, "
     "`commands.allow_run_stop`. `commands.allow: D300-D399` lets a remote config give commands "
     "these addresses, for the devices of this file. `commands.allow: mc-3e FX5U D300-D399` lets "
     "it do so for every device of that protocol and model."},
    {"agent", "remote_without_disk", boolean, {}, false,
     "True if the agent applies a remote config even if the disk refuses to keep it. There is "
     "then no way back."},

    {"mqtt", "servers", array, {}, Required{},
     "One or more of `mqtt://host[:1883]` and `mqtts://host[:8883]`, IPv6 in brackets, IPv4 "
     "without leading zeros. The agent tries them from the first, and one that it has lost last. "
     "After the last one it waits 1 s, then longer, up to 30 s (4 s in the first five minutes of an "
     "outage)."},
    {"mqtt", "version", choice, kVersions, "5", "Version of MQTT."},
    {"mqtt", "client_id", text, {}, Rule{"fx-{id}"},
     "Client id. Two clients of one broker must not share it."},
    {"mqtt", "username", text, {}, None{},
     "User name. MQTT 3.1.1 needs it for a password."},
    {"mqtt", "password_file", path, {}, None{},
     "File with the password. It takes precedence over `password_env`."},
    {"mqtt", "password_env", text, {}, None{},
     "Name of the environment variable with the password."},
    {"mqtt", "password", text, {}, None{},
     "The password itself, or `${NAME}`. Not together with `password_file` or `password_env`, "
     "which are better places."},
    {"mqtt", "allow_plain_secret", boolean, {}, false,
     "Allows a `password` in a config file that others can read."},
    {"mqtt", "tls", object, {}, None{},
     "Files for `mqtts://` servers; without effect on others. The agent always checks the "
     "certificate of the server."},
    {"mqtt", "keep_alive_s", integer, {1, 65535}, 30, "Keep alive of MQTT, in seconds."},
    {"mqtt", "qos", integer, {0, 1}, 1,
     "QoS of the data topics. With 0 a sample counts as delivered when the socket has accepted "
     "it. 2 is refused: under 1 the sequence number shows repeats."},
    {"mqtt", "reconnect_spread_s", integer, {0, 3600}, 0,
     "For fleets: after a loss the agent waits a random time of up to this many seconds longer, and "
     "at least as many between failed attempts, so that a restarted broker is not stormed."},

    {"mqtt.tls", "ca_file", path, {}, Rule{"the system's"}, "Certificate authorities, PEM."},
    {"mqtt.tls", "cert_file", path, {}, None{},
     "Certificate of this agent, PEM; together with `key_file`."},
    {"mqtt.tls", "key_file", path, {}, None{},
     "Private key of this agent, PEM; together with `cert_file`."},

    {"store", "path", path, {}, Required{},
     "A directory. The agent makes it if it does not exist."},
    {"store", "max_bytes", integer, kBytes, 256 << 20,
     "Bytes for samples and records of commands. When they are full, the agent drops the oldest "
     "samples."},
    {"store", "max_age_h", integer, {1, 87600}, 168, "Hours; the agent drops older samples."},
    {"store", "sync", choice, kSyncs, "offline",
     "`offline`: samples go to disk while the broker does not acknowledge them. `always`: every "
     "sample is on disk before it is sent."},
    {"store", "audit_max_bytes", integer, kBytes, 64 << 20,
     "Bytes for the audit. When they are full, the agent removes the oldest records. They do not "
     "count for `max_bytes`."},
    {"store", "audit_max_age_h", integer, {1, 876000}, 8760,
     "Hours; the agent removes older records of the audit."},

    {"http", "listen", text, {}, Required{},
     "`127.0.0.1:8080`, `[::1]:8080` or `unix:/run/fxagent/http`. Serves the page at `/`, and "
     "`/metrics`, `/healthz` and `/readyz`, without password and TLS. Whoever reaches the address "
     "sees every value. Port 0: any free port; the log names it."},
    {"http", "hosts", array, {}, None{},
     "Names by which browsers reach the page, such as `edge7.plant.example`, if it is behind a "
     "proxy or has a name. Addresses and `localhost` need no entry. A request for another name is "
     "refused, so that no web site can read the page through a visitor's browser."},
    {"http", "token_file", path, {}, None{},
     "File with the tokens of those who may send commands from the page; without it the page is "
     "read-only. Each line is `NAME TOKEN`; the audit shows `page:NAME`. A line may also be a "
     "`TOKEN` alone: then NAME is what the command's `by` says. Only with an address that no other "
     "machine can reach, since a token must not travel without TLS."},

    {"metrics", "listen", text, {}, Required{},
     "`127.0.0.1:9464`, `[::1]:9464` or `unix:/run/fxagent/metrics`. Serves `/metrics`, "
     "`/healthz` and `/readyz`, without password and TLS. Port 0: any free port; the log names "
     "it."},

    {"recorder", "path", path, {}, Required{},
     "A directory for the recordings. The agent makes it if it does not exist. Two agents must not "
     "share it."},
    {"recorder", "link_bytes", integer, kRingBytes, Rule{"262144, or an equal share of 16 MiB"},
     "Memory for the frames of each link, in bytes. The default gives all links together at most "
     "16 MiB, and each link at least 4096 bytes."},
    {"recorder", "files", integer, {1, 10000}, 20,
     "Number of recordings. The agent deletes the oldest."},
    {"recorder", "max_bytes", integer, kBytes, 32 << 20,
     "Bytes for the recordings. The agent deletes the oldest."},

    {"pair", "member", name, {}, Required{},
     "Name of this gateway in its pair. The two gateways of a pair have different names; everything "
     "else in their files is equal."},
    {"pair", "quiet_ms", integer, {300, 60000}, 1500,
     "Silence in ms between the last request of the one gateway and the first of the other. An "
     "active gateway that the broker has not acknowledged for half of this time sends nothing."},

    {"links[]", "name", name, {}, Required{}, "Name of the link, unique in the file."},
    {"links[]", "serial", object, {}, None{},
     "A serial port of this machine. A link has one of `serial`, `tcp` and `udp`."},
    {"links[]", "tcp", object, {}, None{},
     "A device, or a transparent serial server."},
    {"links[]", "udp", object, {}, None{},
     "A device with one frame in each datagram."},
    {"links[]", "line_baud", integer, kBaud, Rule{"not known"},
     "Speed of the line behind a serial server, only with `tcp`. Deadlines, `plan` and the bound "
     "of commands depend on it. The agent does not set the server."},
    {"links[]", "data_bits", integer, kBits, kOfProtocol,
     "For the line behind a serial server, only with `line_baud`."},
    {"links[]", "parity", choice, kParities, kOfProtocol,
     "For the line behind a serial server, only with `line_baud`."},
    {"links[]", "stop_bits", integer, kStopBits, kOfProtocol,
     "For the line behind a serial server, only with `line_baud`."},
    {"links[]", "poll_share_percent", integer, {0, 90}, 20,
     "Share of the line time that polls keep while commands flood the line, in percent. A "
     "smaller share makes commands faster. With 0 commands can stop the polls."},
    {"links[]", "allow_yield", boolean, {}, false,
     "Whether a command on the link's topic may free the port for another program, such as GX "
     "Works, for a while. The name of the link must then differ from that of every device."},

    {"links[].serial", "path", path, {}, Required{},
     "The port, preferably by its name in `/dev/serial/by-id/`. Only one link can have a port."},
    {"links[].serial", "baud", integer, kBaud, kOfProtocol, "Any speed that the adapter supports."},
    {"links[].serial", "data_bits", integer, kBits, kOfProtocol,
     "Data bits of a character; `modbus-rtu` needs 8."},
    {"links[].serial", "parity", choice, kParities, kOfProtocol, "Parity of a character."},
    {"links[].serial", "stop_bits", integer, kStopBits, kOfProtocol, "Stop bits of a character."},
    {"links[].serial", "rs485", object, {}, None{},
     "The kernel switches the direction of a two-wire port by its RTS line. Leave it out if the "
     "adapter switches on its own, as most do."},

    {"links[].serial.rs485", "rts_on_send", boolean, {}, true,
     "RTS is high while the port sends. `false`: it is low then, and high otherwise."},
    {"links[].serial.rs485", "delay_before_ms", integer, {0, 100}, 0,
     "Time from the switch of RTS to the first character."},
    {"links[].serial.rs485", "delay_after_ms", integer, {0, 100}, 0,
     "Time from the last character to the switch back."},

    {"links[].tcp", "host", text, {}, Required{},
     "Host name or IP address: IPv4 as four decimal numbers without leading zeros, IPv6 without "
     "brackets."},
    {"links[].tcp", "port", integer, {1, 65535}, Required{},
     "TCP port; for Modbus TCP 502 by custom. Two links to one host and port cause a warning: "
     "many devices accept only one connection."},

    {"links[].udp", "host", text, {}, Required{},
     "Host name or IP address: IPv4 as four decimal numbers without leading zeros, IPv6 without "
     "brackets."},
    {"links[].udp", "port", integer, {1, 65535}, Required{},
     "UDP port of the device, as set in the device."},
    {"links[].udp", "local_port", integer, {1, 65535}, Rule{"any free port"},
     "Port from which the agent sends. Some devices answer only one port, which is set in the "
     "device (open settings: port of the other side). It must be this one."},

    {"devices[]", "name", name, {}, Required{}, "Name of the device, a level of its topics."},
    {"devices[]", "template", name, {}, None{},
     "Name of one of the `templates`. The device takes the keys that it lacks from the template. "
     "Its groups and tags are added to those of the template, or replace those of the same name."},
    {"devices[]", "n", numbers, {}, Rule{"one device"},
     "Many devices of one entry: `\"1-40\"`, `\"01-12,15\"`, or a list of numbers or names. Each "
     "value makes a device and replaces `{n}` in every string of the device and its template."},
    {"devices[]", "link", name, {}, Required{}, "Name of the device's link."},
    {"devices[]", "protocol", text, {}, Required{}, "Protocol of the device."},
    {"devices[]", "model", text, {}, kAutoModel, "Model of the PLC."},
    {"devices[]", "timeout_ms", integer, {1, 600'000}, 1000,
     "Time that a reply may take beyond the expected line time. If this key is missing and the "
     "protocol has a monitoring timer, the agent adds that timer."},
    {"devices[]", "retries", integer, {0, 10}, 2,
     "Number of repeats of a read in the same poll, after a bad frame or a temporary refusal, "
     "not after silence. The device is `offline` after `retries` + 1 unanswered exchanges in a row "
     "(one, if it has not answered since the start)."},
    {"devices[]", "gap_ms", integer, kMilliseconds, 0, "Silence before a request."},
    {"devices[]", "turnaround_ms", integer, kMilliseconds, 30,
     "Time that the device needs before it answers, for `plan` and the bound of commands. The "
     "agent measures it, and makes a new plan if the difference is large."},
    {"devices[]", "echo", boolean, {}, false,
     "True if the line returns everything that is sent (two-wire adapters)."},
    {"devices[]", "max_block_bytes", integer, {2, 65535}, Rule{"the protocol's limit"},
     "Longest block of one read, in bytes."},
    {"devices[]", "groups", array, {}, None{}, "Tags that are read and published together."},
    {"devices[]", "tags", array, {}, None{}, "The values of the device."},
    {"devices[]", "commands", object, {}, None{},
     "Rights and limits of commands. Each tag has its own `access`."},

    {"devices[].groups[]", "name", name, {}, Required{},
     "Name of the group, last level of the data topic."},
    {"devices[].groups[]", "interval_ms", integer, {0, 86'400'000}, 1000,
     "Poll interval; 0: as fast as the line allows."},
    {"devices[].groups[]", "publish", choice, kPublish, "always",
     "`always`: every cycle. `on_change`: when a value differs by at least its `deadband` from "
     "the last published one."},
    {"devices[].groups[]", "max_silent_s", integer, {1, 86'400}, 60,
     "Longest time without a sample while nothing changes."},

    {"devices[].tags[]", "name", name, {}, Required{},
     "Name of the tag, its key in `values` and `bad`."},
    {"devices[].tags[]", "address", text, {}, Required{}, "Place of the value in the device."},
    {"devices[].tags[]", "type", choice, kTypes, Rule{"by the address"}, "Coding of the value."},
    {"devices[].tags[]", "count", integer, kElements, Rule{"one value"},
     "Number of elements. With this key the value is an array, even with one element."},
    {"devices[].tags[]", "length", integer, kElements, None{},
     "Number of characters; required for a `string`, and for strings only."},
    {"devices[].tags[]", "word_order", choice, kWordOrders,
     Rule{"Mitsubishi: `low_first`; Modbus: `byte_order`"},
     "Order of the words of a 32- or 64-bit value; `low_first` is `CDAB`, `high_first` is "
     "`ABCD`. `BADC` and `DCBA` are for Modbus only. Not for `bool`."},
    {"devices[].tags[]", "scale", number, {}, 1, "The value is raw × `scale` + `offset`. Not 0."},
    {"devices[].tags[]", "offset", number, {}, 0, "Added to the scaled value."},
    {"devices[].tags[]", "unit", text, {}, None{},
     "Text for people: °C, bar, 1/min. It may be empty."},
    {"devices[].tags[]", "description", text, {}, None{},
     "Text for people: the meaning of the tag. It may be empty."},
    {"devices[].tags[]", "states", object, {}, None{},
     "Labels of values: `{\"0\": \"idle\", \"1\": \"run\"}`. Each key is a whole number in the unit of "
     "the value; of a `bool` 0 or 1. Not for `string`."},
    {"devices[].tags[]", "min", number, {}, None{},
     "Smallest value that a command may write, after rounding to the raw value. A smaller one is "
     "refused (`out_of_range`)."},
    {"devices[].tags[]", "max", number, {}, None{},
     "Largest value that a command may write, after rounding to the raw value. A larger one is "
     "refused (`out_of_range`)."},
    {"devices[].tags[]", "deadband", number, {}, None{},
     "With `publish: on_change` a smaller difference does not count as a change. Without this "
     "key every difference counts. Not negative."},
    {"devices[].tags[]", "group", name, {}, "default",
     "Name of a group. If `groups` has no group `default`, that group has the default of every "
     "key."},
    {"devices[].tags[]", "access", choice, kAccess, "read",
     "`read_write`: commands may write the tag."},

    {"devices[].commands", "allow", array, {}, None{},
     "Addresses and ranges that commands may use by raw address. Tags need no entry: commands "
     "may read every tag, and write it with `access: read_write`. A command that names the address "
     "is not checked against `min` and `max` of a tag there."},
    {"devices[].commands", "allow_run_stop", boolean, {}, false,
     "True if commands may start and stop the PLC. Without effect on Modbus."},
    {"devices[].commands", "default_expiry_s", integer, kExpiry, 10,
     "Seconds for which a command without `expires` is valid, unless `max_expiry_s` is shorter."},
    {"devices[].commands", "max_expiry_s", integer, kExpiry, 3600,
     "Seconds that `expires` may be ahead of the clock."},
    {"devices[].commands", "verify", boolean, {}, true,
     "True if the agent reads a written word back."},
    {"devices[].commands", "queue", integer, {1, 10000}, 64,
     "Number of commands that may wait in addition to the one under way."},

    {"profiles[]", "kind", choice, kProfiles, Required{},
     "`json`: the topics of interface.md. `plain`: a topic for each tag. `sparkplug`: a Sparkplug "
     "B 3.0 edge node. `homeassistant`: the devices appear in Home Assistant, which reads the "
     "topics of `json`. `thingsboard`: a ThingsBoard gateway. `json` on the broker of `mqtt` must "
     "be among them; a kind may stand once for each broker."},
    {"profiles[]", "broker", name, {}, Rule{"the broker of `mqtt`"},
     "Name of one of the `brokers`."},
    {"profiles[]", "topic", text, {}, "{root}/{id}/{device}/{tag}",
     "`plain`: topic of a tag. `{root}`, `{id}`, `{device}`, `{group}`, `{tag}`, `{site}`, "
     "`{area}` and `{line}` are replaced. Each tag needs a topic of its own."},
    {"profiles[]", "site", text, {}, None{}, "`plain`: replaces `{site}`, the site in ISA-95."},
    {"profiles[]", "area", text, {}, None{}, "`plain`: replaces `{area}`."},
    {"profiles[]", "line", text, {}, None{}, "`plain`: replaces `{line}`."},
    {"profiles[]", "group", text, {}, None{}, "`sparkplug`: the group id. Required there."},
    {"profiles[]", "node", text, {}, Rule{"the agent's id"}, "`sparkplug`: the edge node id."},
    {"profiles[]", "host", text, {}, None{},
     "`sparkplug`: id of the primary host. The agent publishes nothing before this host is online, "
     "and goes to the next server when it is offline."},
    {"profiles[]", "old_state", boolean, {}, false,
     "`sparkplug`: the host announces itself on `STATE/{host}` with `ONLINE` or `OFFLINE`, as "
     "before Sparkplug 3.0."},
    {"profiles[]", "commands", boolean, {}, false,
     "`sparkplug`: also accepts typed commands of Sparkplug C and answers each one. Uses an MQTT "
     "session of its own."},
    {"profiles[]", "prefix", text, {}, "homeassistant",
     "`homeassistant`: first level of its discovery topics."},
    {"profiles[]", "deadline_s", integer, kExpiry, 10,
     "`thingsboard`: seconds for which a command is valid. ThingsBoard passes no deadline on."},

    {"brokers[]", "name", name, {}, Required{}, "Name of the broker, unique in the file."},
    {"brokers[]", "commands", boolean, {}, false,
     "True if commands may come from this broker. Commands from the broker of `mqtt` are always "
     "accepted."},
});
// clang-format on

/// A broker has the keys of `mqtt`.
inline constexpr auto kAll = [] {
  constexpr auto is_of_broker = [](const ConfigKey& key) {
    return key.section == "mqtt" || key.section == "mqtt.tls";
  };
  constexpr auto more = std::ranges::count_if(kWritten, is_of_broker);
  std::array<ConfigKey, kWritten.size() + more> all{};
  auto* next = std::ranges::copy(kWritten, all.begin()).out;
  for (ConfigKey key : kWritten) {
    if (!is_of_broker(key)) continue;
    key.section = key.section == "mqtt" ? "brokers[]" : "brokers[].tls";
    *next++ = key;
  }
  return all;
}();

}  // namespace config_keys

/// Returns the key with this path, such as "mqtt.keep_alive_s". An unknown path does not compile.
consteval const ConfigKey& config_key(std::string_view path) {
  for (const ConfigKey& key : config_keys::kAll)
    if (key.is(path)) return key;
  throw "no such key";
}

/// Returns the keys of one object, such as "devices[].tags[]"; "" is the top level.
constexpr std::span<const ConfigKey> config_section(std::string_view section) {
  const std::span<const ConfigKey> all(config_keys::kAll);
  const auto of = [&](const ConfigKey& key) { return key.section == section; };
  const auto first = std::ranges::find_if(all, of);
  return {first, std::find_if_not(first, all.end(), of)};
}

/// Returns the protocol's own keys of a device: `model`, and the options of the catalogue. They
/// take precedence over keys of the table with the same name.
std::vector<ConfigKey> protocol_keys(const ProtocolInfo& protocol);
ConfigKey option_key(const OptionSpec& option);
ConfigKey model_key(const ProtocolInfo& protocol);
/// Returns the key `protocol`, with the names of the catalogue.
ConfigKey protocol_key();
/// Returns the orders that `word_order` may name: all, or two if the protocol lacks `byte_order`.
std::span<const ByteOrder> word_orders(const ProtocolInfo& protocol);
/// Returns the key `word_order` of tags. nullptr: the words of any protocol.
ConfigKey word_order_key(const ProtocolInfo* protocol);

/// Returns the option with this name; nullptr if the protocol has none.
const OptionSpec* option_named(const ProtocolInfo& protocol, std::string_view key);

}  // namespace fxagent
