// Mitsubishi FX computer link (dedicated protocol): a computer polls stations 0 to 15 on one line.
// Sources: FX Communication User's Manual JY992D69901 rev. E, chapters 7, 8 and 12; limits of FX3
// from JY997D16901.
// A request begins with ENQ, data with STX. ACK and NAK carry the station and no sum.
// protocol/README.md has the frames.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "protocol/fx/device.h"
#include "protocol/mc/dialect_codec.h"
#include "protocol/options.h"

namespace fxagent {
struct LineDefaults;
}

namespace fxagent::fx {

class ComputerLink final : public mc::DialectCodec<ComputerLink> {
 public:
  /// Read::way: BR returns one character for each bit, WR and QR four for each word.
  static constexpr std::uint8_t kBitWay = 0;
  static constexpr std::uint8_t kWordWay = 1;

  /// Uses the settings of D8120 and D8121 of the PLC, from the computer's side: station 0 to 15,
  /// and format 1 or 4, which ends each frame with CR LF.
  explicit ComputerLink(const mc::Dialect& settings) : DialectCodec(settings) {
    settings_.frame = mc::Frame::c1;
    settings_.code = mc::Code::ascii;
    if (settings.model == Model::unknown) settings_.model = Model::unknown_fx;
  }
  /// Creates a codec from the config's options. Error: bad_request if `format` is 2 or 3, or if
  /// `message_wait_ms` is not a multiple of 10.
  static Result<std::shared_ptr<const Codec>> make(const Options& options);

  // AddressSpace
  Result<Address> parse_address(std::string_view text,
                                std::optional<DataType> type) const override {
    return fx::parse_address(settings_.model, text, type);
  }
  bool needs_type(std::string_view text) const override { return fx::needs_type(text); }
  Result<Span> parse_range(std::string_view text) const override {
    return fx::parse_range(settings_.model, text);
  }
  Result<void> check_range(const Span& span) const override {
    return fx::check_range(settings_.model, span);
  }
  Result<void> check_write(const Span& span) const override {
    return fx::check_write(settings_.model, span);
  }
  std::vector<ReadWay> read_ways(std::uint16_t space) const override;
  std::uint32_t max_write_bits(std::uint16_t space) const override;

  // Codec
  Result<Bytes> encode(const Request& request, std::uint16_t tag) const override;
  Decoded decode(const Request& request, std::uint16_t tag, ByteView rx) const override;
  bool expects_reply(const Request& request) const override;
  bool may_pass_for_answer(ByteView bytes) const override;
  LineLength line_length(const Request& request) const override;
  /// With or without sum, in either format. An unknown model counts as FX3U.
  Explanation explain(ByteView frame, std::optional<Direction> direction) const override;

  std::optional<Request> resync() const override { return Control{Control::Kind::reset}; }
  std::optional<Request> probe(std::uint32_t number) const override;
  RefusalMeaning meaning_of(const Request& request, int device_code) const override;

  // PlcServices
  std::optional<std::string> model_from(const std::vector<Bytes>& images) const override;
  SpecialDevices special_devices() const override { return special_devices_of_fx(); }
  Request run_state() const override;
  std::string run_hint() const override;
};

// For the files of this codec.

/// Control character, station and PLC number: a whole ACK, or the head of any other frame.
inline constexpr std::uint32_t kLinkHeader = 5;

/// Returns the text for the code of a NAK: "device does not exist or too many points".
std::string_view link_refusal(int code);
/// Returns the model for an answer to PC: "FX2N". Empty if it is not a model of the catalogue.
std::string_view link_model(int code);

/// Returns the word D8120 of a PLC whose link on RS-485 has these settings; nullopt: no FX has this
/// line. Sources as above; 38400 baud from JY997D16901.
std::optional<std::uint16_t> d8120(const Options& options, const LineDefaults& line);
/// Returns a question for a checklist: "is D8120 H6086 (9600 baud 7E1, RS-485)".
std::string d8120_for(const Options& options, const LineDefaults& line);

}  // namespace fxagent::fx
