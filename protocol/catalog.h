// Lists the protocols by their name in the config, one line each. No protocol registers itself.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "protocol/codec.h"
#include "protocol/options.h"

namespace fxagent {

enum class Parity : std::uint8_t { none, even, odd };

/// Serial settings used if neither the protocol nor the config sets others.
struct LineDefaults {
  int baud = 9600;
  int data_bits = 7;
  Parity parity = Parity::even;
  int stop_bits = 1;
  friend bool operator==(const LineDefaults&, const LineDefaults&) = default;
};

/// How addresses of a protocol are written, for editors and people.
struct AddressForms {
  std::string_view pattern;  ///< regular expression (ECMA 262) of the address of a tag
  std::string_view examples;
  std::string_view types;          ///< the type of a tag that gives none
  std::string_view range_pattern;  ///< as `pattern`, of AddressSpace::parse_range()
  std::string_view range_examples;
};

/// Human-readable settings to check, as questions separated by semicolons. Option names stand in
/// backquotes. checklist.h builds the text: it inserts the option values and ends `silent` with a
/// question mark. `closed` is complete as it stands.
struct SettingHints {
  std::string_view silent;  ///< used if the device has never answered
  std::string_view closed;  ///< used if the device closes a connection before its first answer
};

struct ProtocolInfo {
  std::string_view name;     ///< "fx-programming-port"
  std::string_view summary;  ///< one line for --help
  LineDefaults line;
  bool one_line = false;    ///< no other data bits, parity or stop bits are documented
  std::vector<int> speeds;  ///< documented baud rates; empty: any
  /// Highest baud rate of models not in `fast_models`; 0: all models are alike.
  int most_speed = 0;
  std::vector<std::string_view> fast_models;
  bool on_serial = true;  ///< also on a serial line; every protocol runs over TCP
  /// First character of answers with data in a text protocol: STX or a colon. 0 if answers are
  /// binary or have no fixed first character.
  std::uint8_t text_begins_with = 0;
  bool on_udp = false;      ///< a datagram holds one whole frame
  bool multidrop = false;   ///< frames carry a station or unit, so devices can share a line
  int least_data_bits = 0;  ///< of a serial line; 0: those of `line`
  std::span<const std::string_view> models;  ///< values of `model` besides auto; empty: no models
  /// True if the last of `models` has every device of the others. If false, addresses are checked
  /// against the codec without a model until the PLC has reported its own.
  bool last_is_widest = true;
  std::string_view model_meaning;  ///< human-readable; the schema and the README quote it
  AddressForms address_forms{};
  std::span<const std::string_view> kin;  ///< further model names that `model` accepts
  std::vector<OptionSpec> options;
  SettingHints hints;
  /// Hints that replace `hints` for models whose settings are found in another place.
  std::vector<std::pair<std::string_view, SettingHints>> model_hints;
  /// Human-readable place in the PLC that sets frame format and sum check. Empty: there is none.
  std::string_view format_place;
  /// Returns the PLC setting that these options and this line need: "is D8120 H6086 …".
  std::string (*plc_line_word)(const Options&, const LineDefaults&) = nullptr;
  std::function<Result<std::shared_ptr<const Codec>>(const Options&)> make;
};

/// Returns every protocol, in the order of the README.
std::span<const ProtocolInfo> catalog();
/// Returns the codec that addresses are checked against: `codec` itself, or the widest model's
/// codec if the device must first be asked for its model.
std::shared_ptr<const Codec> widest_of(const ProtocolInfo& protocol,
                                       const std::shared_ptr<const Codec>& codec);
/// Returns the human-readable name of that model: "FX3U, the widest".
std::string widest_name(const ProtocolInfo& protocol);
/// Returns the option that makes this device need 8 data bits, whatever its protocol needs by
/// default. Returns nullptr if no option does.
const OptionSpec* binary_option(const ProtocolInfo& protocol, const Options& options);
/// Returns nullptr if there is no protocol of that name.
const ProtocolInfo* find_protocol(std::string_view name);
/// Returns every option with its default value; `model` is "auto".
Options default_options(const ProtocolInfo& protocol);

}  // namespace fxagent
