// Modbus master: RTU and ASCII on serial lines (or through a transparent serial server), and TCP.
// Sources: MODBUS Application Protocol V1.1b3, MODBUS over Serial Line V1.02, Messaging on TCP/IP
// V1.0b. protocol/README.md has the frames.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "protocol/codec.h"
#include "protocol/modbus/frame.h"
#include "protocol/modbus/pdu.h"
#include "protocol/options.h"

namespace fxagent::modbus {

class Modbus final : public Codec, public AddressSpace {
 public:
  struct Settings {
    Framing framing = Framing::rtu;
    std::uint8_t unit = 1;  ///< 0 is a broadcast on a serial line, and an ordinary unit on TCP
    /// Registers of one read. 16 coils or inputs count as one register.
    std::uint32_t max_read = kMaxReadRegisters;
    /// Longest run of unrequested registers in a read. 16 coils or inputs count as one register.
    std::uint32_t max_gap = 16;
    ByteOrder order = ByteOrder::abcd;
    std::uint32_t address_base = 0;  ///< number of the first item in hr: ir: co: di:
    /// Write a bit of a register by reading and writing the whole register if function 22 fails.
    bool allow_read_modify_write = false;
  };

  explicit Modbus(const Settings& settings) : settings_(settings) {}
  /// Creates a codec from the config's options. Error: bad_request if `unit` is reserved on a
  /// serial line or `byte_order` is no order.
  static Result<std::shared_ptr<const Codec>> make(Framing framing, const Options& options);

  // AddressSpace
  /// Parses hr:100 ir:0 co:5 di:7, hr:100.3 (bit 3), hr:0x64; also 40101 or 400101, by the number
  /// of digits.
  Result<Address> parse_address(std::string_view text, std::optional<DataType> type) const override;
  /// Parses hr:100-hr:119, hr:100-119 or one address.
  Result<Span> parse_range(std::string_view text) const override;
  Result<void> check_range(const Span& span) const override;
  Result<void> check_write(const Span& span) const override;

  std::string name_of(const Span& span) const override;
  std::vector<ReadWay> read_ways(std::uint16_t space) const override;
  std::uint32_t max_write_bits(std::uint16_t space) const override;
  ByteOrder default_order() const override { return settings_.order; }

  // Codec
  const AddressSpace& addresses() const override { return *this; }
  Result<Bytes> encode(const Request& request, std::uint16_t tag) const override;
  Decoded decode(const Request& request, std::uint16_t tag, ByteView rx) const override;
  LineLength line_length(const Request& request) const override;
  bool is_text() const override { return settings_.framing == Framing::ascii; }
  Explanation explain(ByteView frame, std::optional<Direction> direction) const override;

  RefusalMeaning meaning_of(const Request& request, int device_code) const override;
  /// Replaces 06 by 16, 05 by 15, and 22 by read-modify-write if that is allowed.
  std::optional<Request> instead_of(const Request& request, int device_code) const override;

  std::optional<Request> read_before(const Request& request) const override;
  Request with_read(const Request& request, ByteView image) const override;
  std::chrono::nanoseconds quiet_before(std::chrono::nanoseconds char_time) const override;
  std::chrono::milliseconds pause_after(const Request& request) const override;
  bool may_pass_for_answer(ByteView bytes) const override;
  std::uint32_t shorter_by(const Read& read) const override;
  /// Returns a read of one holding register, the function of the simplest devices. A coil would be
  /// one byte shorter, but some devices do not answer functions that they lack.
  std::optional<Request> presence() const override;
  std::optional<Request> identity() const override;
  bool is_broadcast() const override {
    return settings_.framing != Framing::tcp && settings_.unit == 0;
  }
  Recovery after_silence() const override {
    return settings_.framing == Framing::tcp ? Recovery::none : Recovery::drain;
  }
  Recovery after_nonsense() const override {
    return settings_.framing == Framing::tcp ? Recovery::reconnect : Recovery::drain;
  }

 private:
  Settings settings_;
};

/// Returns "hr:100", counted from `base`.
std::string name_of(Space space, std::uint32_t number, std::uint32_t base);

}  // namespace fxagent::modbus
