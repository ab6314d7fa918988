// The list of protocols, by the name the config uses. One line each; nothing registers itself.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "protocol/codec.h"

namespace fxagent {

/// One config key of a device that belongs to its protocol.
struct OptionSpec {
  enum class Kind : std::uint8_t { integer, boolean, choice };
  std::string_view key;
  Kind kind = Kind::integer;
  std::int64_t min = 0;  ///< integer: inclusive bounds
  std::int64_t max = 0;
  std::vector<std::string_view> choices;                        ///< choice: the words
  std::variant<std::int64_t, bool, std::string_view> fallback;  ///< where the key is absent
  std::string_view meaning;  ///< for people: the schema and the README have it
  /// integer: from this value on frames are binary, so that a line needs 8 data bits.
  std::optional<std::int64_t> binary_from{};
};

using OptionValue = std::variant<std::int64_t, bool, std::string>;
/// What `model` is where the device is to be asked.
inline constexpr std::string_view kAutoModel = "auto";
/// Every key of the protocol's specs, given or fallen back. `model` is always there ("auto" too).
using Options = std::map<std::string, OptionValue, std::less<>>;

enum class Parity : std::uint8_t { none, even, odd };

/// How characters travel on a line, where neither protocol nor config says otherwise.
struct LineDefaults {
  int baud = 9600;
  int data_bits = 7;
  Parity parity = Parity::even;
  int stop_bits = 1;
};

/// For a person: the settings to look at, as questions with a semicolon between them and without a
/// mark at the end. Options stand in backquotes. checklist.h makes a text of them.
struct SettingHints {
  std::string_view silent;  ///< when nothing was ever answered
  std::string_view closed;  ///< when the device closes a connection before its first answer
};

struct ProtocolInfo {
  std::string_view name;     ///< "fx-programming-port"
  std::string_view summary;  ///< one line for --help
  LineDefaults line;
  bool one_line = false;    ///< no other data bits, parity and stop bits are known of it
  std::vector<int> speeds;  ///< baud that its documents know; empty: any
  int most_speed = 0;       ///< of them, of all models but the fast ones; 0: models do not matter
  std::vector<std::string_view> fast_models;
  bool on_serial = true;
  bool on_tcp = true;
  /// The character that its answers with data begin with, where they are text: STX, a colon. 0:
  /// they are not, or begin with nothing of their own.
  std::uint8_t text_begins_with = 0;
  bool on_udp = false;      ///< a datagram holds one whole frame
  bool multidrop = false;   ///< frames carry a station or unit, so devices can share a line
  int least_data_bits = 0;  ///< of a line; 0: those of `line`
  std::vector<std::string_view> models;  ///< what `model` may be, besides auto; empty: it has none
  /// Whether the last of them has all devices of the others. Else addresses are held against the
  /// codec that knows no model, until the PLC has told its own.
  bool last_is_widest = true;
  std::string_view model_meaning;     ///< for people: the schema and the README have it
  std::vector<std::string_view> kin;  ///< further names of them, which `model` may be too
  std::vector<OptionSpec> options;
  SettingHints hints;
  /// In place of them for models that are set up elsewhere.
  std::vector<std::pair<std::string_view, SettingHints>> model_hints;
  /// For a person: where in the PLC format and sum check of its frames are set. Empty: nowhere.
  std::string_view format_place;
  /// Returns the setting of the PLC that these options and this line need: "is D8120 H6086 …".
  std::string (*plc_line_word)(const Options&, const LineDefaults&) = nullptr;
  Result<std::shared_ptr<const Codec>> (*make)(const Options&) = nullptr;
};

/// Every protocol, in the order of the README.
std::span<const ProtocolInfo> catalog();
/// What addresses are held against: `codec` itself, or the widest model where it must ask for its
/// own.
std::shared_ptr<const Codec> widest_of(const ProtocolInfo& protocol,
                                       const std::shared_ptr<const Codec>& codec);
/// The name of that model for a person: "FX3U, the widest".
std::string widest_name(const ProtocolInfo& protocol);
/// The option by which such a device needs 8 data bits, whatever its protocol does by itself;
/// nullptr where none does.
const OptionSpec* binary_option(const ProtocolInfo& protocol, const Options& options);
/// nullptr where there is none of that name.
const ProtocolInfo* find_protocol(std::string_view name);
/// Every option as it is where the config says nothing; `model` is "auto".
Options default_options(const ProtocolInfo& protocol);

}  // namespace fxagent
