// Modbus master: RTU and ASCII on serial lines (or through a transparent serial server), and TCP.
// Sources: MODBUS Application Protocol V1.1b3, MODBUS over Serial Line V1.02, Messaging on TCP/IP
// V1.0b. The frames are in protocol/README.md.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "protocol/catalog.h"
#include "protocol/codec.h"
#include "protocol/modbus/frame.h"
#include "protocol/modbus/pdu.h"

namespace fxagent::modbus {

class Modbus final : public Codec, public AddressSpace {
 public:
  struct Settings {
    Framing framing = Framing::rtu;
    std::uint8_t unit = 1;  ///< 0 is everybody on a serial line, and a unit like others on TCP
    std::uint32_t max_read = kMaxReadRegisters;  ///< registers of one read; 16 bits for each
    std::uint32_t max_gap = 16;  ///< registers in a row that nobody asked for, 16 bits for each
    ByteOrder order = ByteOrder::abcd;
    std::uint32_t address_base = 0;  ///< number of the first one in hr: ir: co: di:
    /// Whether a bit of a register may be written by reading the register, where function 22 fails.
    bool allow_read_modify_write = false;
  };

  explicit Modbus(const Settings& settings) : settings_(settings) {}
  /// From the config's options.
  static Result<std::shared_ptr<const Codec>> make_rtu(const Options& options);
  static Result<std::shared_ptr<const Codec>> make_ascii(const Options& options);
  static Result<std::shared_ptr<const Codec>> make_tcp(const Options& options);

  // AddressSpace
  /// hr:100 ir:0 co:5 di:7, hr:100.3 (bit 3), hr:0x64; 40101 or 400101, by the count of digits.
  Result<Address> parse_address(std::string_view text, std::optional<DataType> type) const override;
  bool needs_type(std::string_view text) const override;
  /// hr:100-hr:119, hr:100-119 or one of them.
  Result<Span> parse_range(std::string_view text) const override;
  Result<void> check_range(const Span& span) const override;
  Result<void> check_write(const Span& span) const override;

  std::string name_of(const Span& span) const override;
  std::vector<ReadWay> read_ways(std::uint16_t space) const override;
  std::uint32_t max_write_bits(std::uint16_t space) const override;
  ByteOrder default_order() const override;

  // Codec
  const AddressSpace& addresses() const override { return *this; }
  Result<Bytes> encode(const Request& request, std::uint16_t tag) const override;
  Result<std::optional<Reply>> decode(const Request& request, std::uint16_t tag,
                                      ByteView rx) const override;
  bool expects_reply(const Request& request) const override;
  LineLength line_length(const Request& request) const override;
  bool is_text() const override { return settings_.framing == Framing::ascii; }
  Explanation explain(ByteView frame, std::optional<Direction> direction) const override;

  RefusalMeaning meaning_of(const Request& request, int device_code) const override;
  /// 06 → 16, 05 → 15, and 22 → reading, changing and writing, where that is allowed.
  std::optional<Request> instead_of(const Request& request, int device_code) const override;

  std::optional<Request> read_before(const Request& request) const override;
  Request with_read(const Request& request, ByteView image) const override;
  std::chrono::nanoseconds quiet_before(std::chrono::nanoseconds char_time) const override;
  std::chrono::milliseconds pause_after(const Request& request) const override;
  bool may_pass_for_answer(ByteView bytes) const override;
  std::optional<Request> apart_from(const Request& request) const override;
  /// One holding register: the function that the plainest devices have. A coil would be a byte
  /// shorter, and some devices are silent to functions that they lack.
  std::optional<Request> presence() const override;
  bool is_broadcast() const override;
  Recovery after_silence() const override;
  Recovery after_nonsense() const override;

 private:
  static Result<std::shared_ptr<const Codec>> make(Framing framing, const Options& options);
  Result<std::optional<Reply>> decode_rtu(const Request& request, ByteView pdu, ByteView rx) const;
  Result<std::optional<Reply>> decode_ascii(const Request& request, ByteView pdu,
                                            ByteView rx) const;
  Result<std::optional<Reply>> decode_tcp(const Request& request, ByteView pdu, std::uint16_t tag,
                                          ByteView rx) const;

  Settings settings_;
};

/// "hr:100", counted from `base`.
std::string name_of(Space space, std::uint32_t number, std::uint32_t base);

/// `fxagent decode`: one frame in words. Any bytes are allowed; what is wrong with them is in the
/// error of the explanation.
Explanation explain_frame(Framing framing, ByteView frame, std::optional<Direction> direction);

}  // namespace fxagent::modbus
