// MC protocol, 1E frames ("A compatible 1E"): FX3 behind FX3U-ENET(-ADP) or with its own port
// (FX3GE), and the E71 modules of Q and L.
// Sources: FX3U-ENET-ADP User's Manual JY997D45801, chapter 7 and 9.3; FX3U-ENET User's Manual
// JY997D18101, chapter 9; SH-080008 (iQ-R edition), chapter 18.
// A request begins with its command, the answer with the same and 80h. Neither has a length, a
// number or a sum. Only the request determines the length of the answer, so one request is sent at
// a time, and a missing answer requires a new connection. protocol/README.md has the frames.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "protocol/mc/dialect_codec.h"

namespace fxagent::mc {

/// Read::way: kBitWay is 00, with half a byte for each bit; kWordWay is 01.
class OneE final : public DialectCodec<OneE> {
 public:
  /// Uses the model (unknown, FX3, Q or L), the code, the PC number of the route, and the timer of
  /// the module for an answer of the PLC: 0 would wait forever.
  explicit OneE(const Dialect& settings) : DialectCodec(settings) {
    settings_.frame = Frame::e1;
    settings_.model = seen_by_1e(settings.model);
  }
  /// Creates a codec from the config's options. Errors as dialect_from().
  static Result<std::shared_ptr<const Codec>> make(const Options& options) {
    return dialect_from(Frame::e1, options).map(made);
  }

  // AddressSpace
  Result<Address> parse_address(std::string_view text, std::optional<DataType> type) const override;
  bool needs_type(std::string_view text) const override { return mc::needs_type(text); }
  Result<Span> parse_range(std::string_view text) const override;
  Result<void> check_range(const Span& span) const override {
    return mc::check_range(settings_.model, span);
  }
  Result<void> check_write(const Span& span) const override;
  std::vector<ReadWay> read_ways(std::uint16_t space) const override;
  std::uint32_t max_write_bits(std::uint16_t space) const override;

  // Codec
  Result<Bytes> encode(const Request& request, std::uint16_t tag) const override;
  Decoded decode(const Request& request, std::uint16_t tag, ByteView rx) const override;
  bool may_pass_for_answer(ByteView bytes) const override;
  LineLength line_length(const Request& request) const override;
  std::chrono::milliseconds gives_up_after() const override;
  /// In binary or ASCII, whatever `code` is.
  Explanation explain(ByteView frame, std::optional<Direction> direction) const override;
  Recovery after_silence() const override { return Recovery::reconnect; }
  Recovery after_nonsense() const override { return Recovery::reconnect; }
  std::optional<Request> probe(std::uint32_t number) const override;
  std::uint32_t shorter_by(const Read& read) const override;
  RefusalMeaning meaning_of(const Request& request, int device_code) const override;

  // PlcServices
  std::optional<std::string> model_from(const std::vector<Bytes>& images) const override;
  SpecialDevices special_devices() const override;
  Request run_state() const override;
  std::optional<bool> run_state_from(ByteView image) const override;
  std::string run_hint() const override;
};

// For the files of this codec. Sources: JY997D45801, 7.6.3 and 9.3; SH-080008, 18.2.
namespace one_e {

/// First byte of a request. The answer has the same with 80h added.
enum class Command : std::uint8_t {
  read_bits = 0x00,
  read_words = 0x01,
  write_bits = 0x02,
  write_words = 0x03,
  random_bits = 0x04,
  random_words = 0x05,
  run = 0x13,
  stop = 0x14,
  model = 0x15,
  loop_back = 0x16,
};
constexpr std::uint8_t code(Command command) { return static_cast<std::uint8_t>(command); }
inline constexpr std::uint8_t kAnswer = 0x80;

/// Returns the binary form of `frame`, read as hex digits. Its words are still high byte first.
/// Drops a single last digit. nullopt: the frame is not hex digits.
std::optional<Bytes> from_ascii(ByteView frame);
/// Returns "FX3U" for the first byte of an answer to 15; empty: not a model of the catalogue.
std::string_view model_coded(int code);
/// Returns "57: too many points, or beyond the last device" for the end code of a refusal and,
/// after 5B, its abnormal code.
std::string refusal(int end_code, std::optional<int> abnormal_code);

}  // namespace one_e

}  // namespace fxagent::mc
