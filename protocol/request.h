// Requests, which a codec (codec.h) encodes into frames, and replies, which it decodes from them;
// their length on the line, and the meaning of a refusal.
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

// ---- requests and replies -------------------------------------------------------------------

/// Asks if the device is there. Also puts its receiver into a known state (programming port: ENQ).
struct Enquire {
  friend bool operator==(const Enquire&, const Enquire&) = default;
};
/// Reads `span` by one of the ways that its address space offers (ReadWay::way).
struct Read {
  Span span;
  std::uint8_t way = 0;
  std::uint8_t gather = 0;  ///< ReadWay::gather of that way; not 0 only in a part of a Gather
  friend bool operator==(const Read&, const Read&) = default;
};
/// Overwrites whole units of a space; `image` covers exactly `span`. `way` 0 is the codec's
/// preferred function; instead_of() returns the others.
struct Write {
  Span span;
  Bytes image;
  std::uint8_t way = 0;
  friend bool operator==(const Write&, const Write&) = default;
};
/// Sets or clears one bit without changing its neighbours.
struct Force {
  std::uint16_t space = 0;
  std::uint32_t bit = 0;
  bool on = false;
  std::uint8_t way = 0;  ///< as in Write
  friend bool operator==(const Force&, const Force&) = default;
};
/// Several writes to scattered places in one frame. A bit has a span of one bit.
struct Scatter {
  std::vector<Write> parts;
  friend bool operator==(const Scatter&, const Scatter&) = default;
};
/// At least one read of scattered places in one frame, all by the same GatherCommand, in any order.
/// The image of the reply holds the images of the parts in their order. Each begins at a whole
/// byte.
struct Gather {
  std::vector<Read> parts;
  friend bool operator==(const Gather&, const Gather&) = default;
};
/// Functions besides memory access: a reset of the line, and the services of plc.h.
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

/// The answer to a request.
struct Reply {
  enum class Kind : std::uint8_t { ack, nak, data } kind = Kind::ack;
  Bytes image{};        ///< data: the image of the request's span, or the answer to identify
  int device_code = 0;  ///< nak: the reason; 0 if the protocol gives none
  std::string text{};   ///< nak: the reason in words ("nak 06: device does not exist")
  Bytes closing{};      ///< to be sent after this reply, without waiting for an answer
  /// Offset of the reply's frame in rx; bytes before it are an echo or older.
  std::size_t began = 0;
  std::size_t consumed = 0;  ///< offset of the reply's end in rx; later bytes do not belong to it
};

/// An answer in received bytes. nullopt if they hold none yet; an error if they cannot become one.
using Decoded = Result<std::optional<Reply>>;

// ---- timing ------------------------------------------------------------------------------------

/// Characters on the line in each direction for one successful exchange.
struct LineLength {
  std::uint32_t request_chars = 0;
  std::uint32_t reply_chars = 0;
  std::uint32_t closing_chars = 0;
  /// Extra characters that the values of a reply may cause, such as bytes doubled on the wire.
  /// Deadlines and bounds include them; plans do not.
  std::uint32_t more_reply_chars = 0;
  /// Characters of request and reply that only double another one, because of an address or a
  /// length. Plans ignore these too: the price of a read depends on its length, not on its place.
  std::uint32_t doubled_chars = 0;

  /// Returns the characters that a plan counts, in all directions.
  std::uint32_t planned_chars() const {
    return request_chars + reply_chars + closing_chars - doubled_chars;
  }
};

// ---- refusals and recovery ---------------------------------------------------------------------

/// Meaning of a refusal for the request and for the device.
enum class RefusalMeaning : std::uint8_t {
  final,        ///< certainly no effect; a repeat would be refused again
  curable,      ///< certainly no effect; a repeat may succeed
  busy,         ///< as curable, but after a pause
  unclear,      ///< a write may have taken effect; handled like silence
  hole,         ///< reads only: something in it does not exist on this device; read less
  unreachable,  ///< reads only: sent by a gateway, because the unit behind it did not answer
};

/// Action that a line needs before its next request.
enum class Recovery : std::uint8_t {
  drain,      ///< wait until the line is quiet, then resync()
  none,       ///< answers are numbered, so a late one cannot be mistaken
  reconnect,  ///< frame boundaries are lost; only a new connection helps
};

}  // namespace fxagent
