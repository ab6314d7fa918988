// Requests to a device, and its replies, in a form that all protocols share. A codec (codec.h)
// encodes a request into a frame, and decodes the reply from what it receives. value/span.h has
// spans and images.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "protocol/value/bytes.h"
#include "protocol/value/result.h"
#include "protocol/value/span.h"

namespace fxagent {

// ---- requests ----------------------------------------------------------------------------------

/// Reads one span.
struct Read {
  Span span;
  std::uint8_t way = 0;     ///< command to use: ReadWay::way of the address space
  std::uint8_t gather = 0;  ///< part of a Gather: GatherCommand::gather; 0: sent alone
  friend bool operator==(const Read&, const Read&) = default;
};
/// Reads scattered spans, at least one, in one frame: in any order, all with the same `gather`. The
/// image of the reply holds those of the parts in their order, each from a whole byte on.
struct Gather {
  std::vector<Read> parts;
  friend bool operator==(const Gather&, const Gather&) = default;
};
/// Overwrites one span: whole units of its space, or one bit in a Scatter.
struct Write {
  Span span;
  Bytes image;           ///< covers exactly `span`
  std::uint8_t way = 0;  ///< 0: the codec's preferred function; Codec::instead_of() has the others
  friend bool operator==(const Write&, const Write&) = default;
};
/// Overwrites scattered spans in one frame.
struct Scatter {
  std::vector<Write> parts;
  friend bool operator==(const Scatter&, const Scatter&) = default;
};
/// Sets or clears one bit without changing its neighbours.
struct Force {
  std::uint16_t space = 0;
  std::uint32_t bit = 0;
  bool on = false;
  std::uint8_t way = 0;  ///< as in Write
  friend bool operator==(const Force&, const Force&) = default;
};
/// Asks if the device is there. Also puts its receiver into a known state (programming port: ENQ).
struct Enquire {
  friend bool operator==(const Enquire&, const Enquire&) = default;
};
/// Resets the line, or asks for a service of the PLC itself (plc.h).
struct Control {
  enum class Kind : std::uint8_t { identify, run, stop, reset } kind = Kind::identify;
  friend bool operator==(const Control&, const Control&) = default;
};
using Request = std::variant<Enquire, Read, Write, Force, Control, Scatter, Gather>;

/// True for Read and Gather: only data answers them, never an ACK.
inline bool is_read(const Request& request) {
  return std::holds_alternative<Read>(request) || std::holds_alternative<Gather>(request);
}
/// True if the request asks what the device is.
inline bool is_identify(const Request& request) {
  const auto* control = std::get_if<Control>(&request);
  return control != nullptr && control->kind == Control::Kind::identify;
}
/// True if a good answer has an image.
inline bool brings_data(const Request& request) { return is_read(request) || is_identify(request); }

// ---- replies -----------------------------------------------------------------------------------

/// The answer to a request, decoded from received bytes `rx`.
struct Reply {
  enum class Kind : std::uint8_t { ack, nak, data } kind = Kind::ack;
  Bytes image{};             ///< data: the image of the request's span, or the answer to identify
  int device_code = 0;       ///< nak: the reason; 0 if the protocol gives none
  std::string text{};        ///< nak: the reason in words ("nak 06: device does not exist")
  Bytes closing{};           ///< bytes to send after this reply; nothing answers them
  std::size_t began = 0;     ///< first byte of the reply in rx; an echo or older bytes precede it
  std::size_t consumed = 0;  ///< end of the reply in rx; later bytes do not belong to it
};
/// nullopt if more bytes are needed; an error if they cannot become an answer.
using Decoded = Result<std::optional<Reply>>;

/// Meaning of a refusal (nak) for the request and for the device.
enum class RefusalMeaning : std::uint8_t {
  final,        ///< certainly no effect; a repeat would be refused again
  curable,      ///< certainly no effect; a repeat may succeed
  busy,         ///< as curable, but after a pause
  unclear,      ///< a write may have taken effect; handled like silence
  hole,         ///< reads only: something in it does not exist on this device; read less
  unreachable,  ///< reads only: sent by a gateway, because the unit behind it did not answer
};

// ---- the line ----------------------------------------------------------------------------------

/// Characters on the line in each direction for one successful exchange.
struct LineLength {
  std::uint32_t request_chars = 0;
  std::uint32_t reply_chars = 0;
  std::uint32_t closing_chars = 0;
  /// Most characters that the reply may have in addition, because of its values: bytes doubled on
  /// the wire. Deadlines and bounds include them; plans do not.
  std::uint32_t more_reply_chars = 0;
  /// Characters of request and reply that only double another one, because of an address or a
  /// length. Plans leave them out: the price of a read depends on its length, not on its place.
  std::uint32_t doubled_chars = 0;

  /// Returns the characters that a plan counts, in all directions.
  std::uint32_t planned_chars() const {
    return request_chars + reply_chars + closing_chars - doubled_chars;
  }
};

/// Action that a line needs before its next request.
enum class Recovery : std::uint8_t {
  drain,      ///< wait until the line is quiet, then resync()
  none,       ///< answers are numbered, so a late one cannot be mistaken
  reconnect,  ///< frame boundaries are lost; only a new connection helps
};

}  // namespace fxagent
