// Mitsubishi FX programming port: reads and writes of device memory, one request at a time.
// Sources: GX Developer and GX Works2 captures; no manual of this protocol is published.
// protocol/README.md has the frames and lists which of them are unverified. A frame is ASCII hex
// between STX and ETX, then a sum. The answer to a write is a single ACK or NAK without a sum.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "protocol/codec.h"
#include "protocol/fx/device.h"
#include "protocol/fx/port_map.h"
#include "protocol/options.h"
#include "protocol/plc.h"

namespace fxagent::fx {

class ProgrammingPort final : public Codec, public AddressSpace, public PlcServices {
 public:
  /// Commands that may be used. `automatic` uses the classic ones wherever they reach.
  enum class Commands : std::uint8_t { automatic, classic, extended };
  struct Settings {
    Model model = Model::unknown_fx;
    Commands commands = Commands::automatic;
    /// Data bytes of one frame. Only extended reads of an FX3 use more than 64.
    std::uint32_t max_block_bytes = 64;
  };
  /// Read::way of the two command sets.
  static constexpr std::uint8_t kClassicWay = 0;
  static constexpr std::uint8_t kExtendedWay = 1;

  explicit ProgrammingPort(const Settings& settings) : settings_(settings) {}
  /// Creates a codec from the config's options. Error: bad_request if `command_set` is extended and
  /// the model has no extended set.
  static Result<std::shared_ptr<const Codec>> make(const Options& options);

  // AddressSpace
  Result<Address> parse_address(std::string_view text, std::optional<DataType> type) const override;
  bool needs_type(std::string_view text) const override { return fx::needs_type(text); }
  Result<Span> parse_range(std::string_view text) const override;
  Result<void> check_range(const Span& span) const override;
  Result<void> check_write(const Span& span) const override {
    return fx::check_write(settings_.model, span);
  }

  std::string name_of(const Span& span) const override { return device_name(span); }
  std::vector<ReadWay> read_ways(std::uint16_t space) const override;
  std::vector<std::uint32_t> borders(std::uint16_t space) const override;
  std::uint32_t max_write_bits(std::uint16_t space) const override;

  // Codec
  const AddressSpace& addresses() const override { return *this; }
  const PlcServices* plc() const override { return this; }
  Result<Bytes> encode(const Request& request, std::uint16_t tag) const override;
  Decoded decode(const Request& request, std::uint16_t tag, ByteView rx) const override;
  bool may_pass_for_answer(ByteView bytes) const override;
  LineLength line_length(const Request& request) const override;
  bool is_text() const override { return true; }
  /// The model decides what an extended address means. An unknown one counts as FX3U.
  Explanation explain(ByteView frame, std::optional<Direction> direction) const override;

  std::optional<Request> resync() const override { return Enquire{}; }
  std::optional<Request> probe(std::uint32_t number) const override;
  RefusalMeaning meaning_of(const Request& request, int device_code) const override;

  // PlcServices
  std::string model() const override { return std::string(to_string(settings_.model)); }
  std::vector<Request> identify() const override;
  std::optional<std::string> model_from(const std::vector<Bytes>& images) const override;
  std::shared_ptr<const Codec> with_model(std::string_view model) const override;
  SpecialDevices special_devices() const override { return special_devices_of_fx(); }
  Request run_state() const override;
  Request run_request(bool run) const override;
  std::string run_hint() const override;

 private:
  Settings settings_;
};

}  // namespace fxagent::fx
