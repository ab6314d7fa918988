// MC protocol (SLMP) of FX5, Q, L and iQ-R: 3E and 4E frames on Ethernet, 3C and 4C on serial
// lines. Sources: SH-080008 (MELSEC Communication Protocol), JY997D56001 (FX5), and frames captured
// from PLCs. protocol/README.md lists their content and where they disagree.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "protocol/mc/dialect_codec.h"
#include "protocol/mc/ethernet_frame.h"
#include "protocol/mc/serial_frame.h"

namespace fxagent::mc {

class Mc final : public DialectCodec<Mc> {
 public:
  explicit Mc(const Dialect& settings) : DialectCodec(settings) {
    if (is_serial(settings.frame))
      settings_.code = settings.format == 5 ? Code::binary : Code::ascii;
  }
  /// Creates a codec from the config's options. Errors as dialect_from().
  static Result<std::shared_ptr<const Codec>> make(Frame frame, const Options& options) {
    return dialect_from(frame, options).map(made);
  }

  // AddressSpace
  Result<Address> parse_address(std::string_view text, std::optional<DataType> type) const override;
  bool needs_type(std::string_view text) const override { return mc::needs_type(text); }
  Result<Span> parse_range(std::string_view text) const override {
    return mc::parse_range(settings_.model, text);
  }
  Result<void> check_range(const Span& span) const override;
  Result<void> check_write(const Span& span) const override;

  std::vector<ReadWay> read_ways(std::uint16_t space) const override {
    return mc::read_ways(settings_, space);
  }
  std::vector<GatherCommand> gathers() const override { return mc::gathers(settings_); }
  std::uint32_t max_write_bits(std::uint16_t space) const override {
    return mc::max_write_bits(settings_, space);
  }

  // Codec
  Result<Bytes> encode(const Request& request, std::uint16_t tag) const override;
  Decoded decode(const Request& request, std::uint16_t tag, ByteView rx) const override;
  bool may_pass_for_answer(ByteView bytes) const override;
  LineLength line_length(const Request& request) const override;
  /// In any code and format.
  Explanation explain(ByteView frame, std::optional<Direction> direction) const override;

  std::chrono::milliseconds gives_up_after() const override;
  Recovery after_silence() const override;
  Recovery after_nonsense() const override;
  std::optional<Request> probe(std::uint32_t number) const override;
  std::uint32_t shorter_by(const Read& read) const override;
  RefusalMeaning meaning_of(const Request& request, int device_code) const override;
  /// Returns the request with the device codes of Q and L in place of those of iQ-R. Excludes X and
  /// Y, which are octal on an FX5.
  std::optional<Request> instead_of(const Request& request, int device_code) const override;

  // PlcServices
  std::optional<std::string> model_from(const std::vector<Bytes>& images) const override;
  SpecialDevices special_devices() const override;
  Request run_state() const override;
  std::optional<bool> run_state_from(ByteView image) const override;
  std::string run_hint() const override;
};

/// Returns the model for the type name in an answer to 0101 ("FX5U-32MT/ES", "R08CPU"). Empty if it
/// is not a model of the catalogue.
std::string_view model_of_type(std::string_view type_name);

}  // namespace fxagent::mc
