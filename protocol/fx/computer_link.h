// Mitsubishi FX computer link (dedicated protocol): a computer polls stations 0 to 15 on one line.
// Sources: FX Communication User's Manual JY992D69901 rev. E, chapters 7, 8 and 12; limits of FX3
// from JY997D16901.
// A request begins with ENQ, data with STX. ACK and NAK carry the station and no sum.
// protocol/README.md has the frames.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "protocol/codec.h"
#include "protocol/fx/device.h"
#include "protocol/fx/link_request.h"
#include "protocol/options.h"
#include "protocol/plc.h"

namespace fxagent::fx {

class ComputerLink final : public Codec, public AddressSpace, public PlcServices {
 public:
  using Settings = LinkSettings;
  static constexpr std::uint8_t kBitWay = link::kBitWay;
  static constexpr std::uint8_t kWordWay = link::kWordWay;

  explicit ComputerLink(const Settings& settings) : settings_(settings) {}
  /// Creates a codec from the config's options. Error: bad_request if `format` is 2 or 3, or if
  /// `message_wait_ms` is not a multiple of 10.
  static Result<std::shared_ptr<const Codec>> make(const Options& options);

  // AddressSpace
  Result<Address> parse_address(std::string_view text, std::optional<DataType> type) const override;
  bool needs_type(std::string_view text) const override { return fx::needs_type(text); }
  Result<Span> parse_range(std::string_view text) const override;
  Result<void> check_range(const Span& span) const override;
  Result<void> check_write(const Span& span) const override;

  std::string name_of(const Span& span) const override { return device_name(span); }
  std::vector<ReadWay> read_ways(std::uint16_t space) const override;
  std::uint32_t max_write_bits(std::uint16_t space) const override;

  // Codec
  const AddressSpace& addresses() const override { return *this; }
  const PlcServices* plc() const override { return this; }
  Result<Bytes> encode(const Request& request, std::uint16_t tag) const override;
  Result<std::optional<Reply>> decode(const Request& request, std::uint16_t tag,
                                      ByteView rx) const override;
  bool expects_reply(const Request& request) const override;
  bool may_pass_for_answer(ByteView bytes) const override;
  LineLength line_length(const Request& request) const override;
  bool is_text() const override { return true; }
  Explanation explain(ByteView frame, std::optional<Direction> direction) const override;

  std::optional<Request> resync() const override { return Control{Control::Kind::reset}; }
  std::optional<Request> probe(std::uint32_t number) const override;
  RefusalMeaning meaning_of(const Request& request, int device_code) const override;

  // PlcServices
  std::string model() const override { return std::string(to_string(settings_.model)); }
  std::optional<std::string> model_from(const std::vector<Bytes>& images) const override;
  std::shared_ptr<const Codec> with_model(std::string_view model) const override;
  SpecialDevices special_devices() const override { return special_devices_of_fx(); }
  Request run_state() const override;
  std::optional<bool> run_state_from(ByteView image) const override;
  std::string run_hint() const override;

 private:
  Settings settings_;
};

/// Explains one frame for `fxagent decode`, with or without sum, in either format, with the devices
/// of `model` (FX3U if it is unknown). Accepts any bytes; the explanation's `error` states what is
/// wrong with them.
Explanation explain_link_frame(Model model, ByteView frame, std::optional<Direction> direction);

}  // namespace fxagent::fx
