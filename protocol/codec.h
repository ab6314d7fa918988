// The wire format of a protocol: the bytes of requests and answers, their timing, and the recovery
// after a missing answer. address_space.h describes the memory behind it, plc.h the PLC itself; a
// codec gives access to both.
// A codec is a value: made once per device from its options, const afterwards, without state or
// clock.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "protocol/address_space.h"
#include "protocol/value/bytes.h"
#include "protocol/value/point.h"
#include "protocol/value/result.h"

namespace fxagent {

class PlcServices;

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

// ---- explanation of a frame --------------------------------------------------------------------

/// Direction of a frame: to the device, or from it.
enum class Direction : std::uint8_t { request, reply };

/// The output of `fxagent decode` for one frame. Optional fields are set if the frame has that
/// part.
struct Explanation {
  bool ok = false;
  Direction direction = Direction::request;
  bool ambiguous = false;              ///< the bytes are a valid frame in both directions
  std::string operation;               ///< read write force_on force_off enquire ack nak data other
  std::optional<std::string> command;  ///< "0", "E00", "BR", "03" …
  std::optional<std::string> command_set;  ///< "classic" or "extended"
  std::optional<std::uint32_t> format;  ///< if the protocol has several formats around one content
  /// Head device as the manual writes it; for a scattered write all devices: "M50,S100,Y1".
  std::optional<std::string> device;
  std::optional<std::uint32_t> count;  ///< devices of that kind: words, or bits
  std::vector<std::string> values;     ///< words as 4 hex digits, bits as 0/1
  std::optional<std::string> checksum_given;
  std::optional<std::string> checksum_computed;
  std::optional<std::string> error;  ///< the reason if the frame is not valid
  /// Name and meaning of each part, in order.
  std::vector<std::pair<std::string, std::string>> fields;
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

// ---- the codec ---------------------------------------------------------------------------------

/// The wire format of one device. protocol/README.md lists the sources of each protocol.
class Codec {
 public:
  virtual ~Codec() = default;

  // Memory and services behind the wire.

  /// Returns names, ranges and limits of the memory; valid as long as the codec.
  virtual const AddressSpace& addresses() const = 0;
  /// Returns the services for the PLC itself; valid as long as the codec. nullptr if the protocol
  /// has none.
  virtual const PlcServices* plc() const { return nullptr; }

  // Bytes.

  /// Returns the frame for a request. `tag` numbers the exchange if the protocol has a field for
  /// it. Errors: unsupported (not possible with this model or protocol), bad_request (outside the
  /// limits of addresses()).
  virtual Result<Bytes> encode(const Request& request, std::uint16_t tag) const = 0;
  /// False if the request has no answer (EOT, a broadcast).
  virtual bool expects_reply(const Request& /*request*/) const { return !is_broadcast(); }
  /// True if every device listens and none answers: no tags, and the only outcome is `broadcast`.
  virtual bool is_broadcast() const { return false; }
  /// Decodes the answer to `request`, for which encode() gave a frame and expects_reply() is true.
  /// `rx`: what was received since, without the line's echo; of datagrams only the last one.
  /// Returns nullopt if more bytes are needed. A refusal is a Reply with Kind::nak, not an error.
  /// Error: bad_frame if the bytes cannot become an answer.
  virtual Result<std::optional<Reply>> decode(const Request& request, std::uint16_t tag,
                                              ByteView rx) const = 0;
  /// True if unrequested bytes could be all or part of an answer to the next request, whatever it
  /// is, or come from another master. Bytes that cannot form an answer are noise.
  virtual bool may_pass_for_answer(ByteView bytes) const { return !bytes.empty(); }
  /// True if frames are text: digits and letters between control characters, none of which needs an
  /// eighth bit.
  virtual bool is_text() const { return false; }
  /// Explains one frame. Without a direction it assumes the likelier one.
  virtual Explanation explain(ByteView frame, std::optional<Direction> direction) const = 0;

  // Timing.

  /// Returns the characters of one successful exchange of `request`. The planner relies on this: a
  /// part adds the same length to a Gather whatever its other parts are.
  virtual LineLength line_length(const Request& request) const = 0;
  /// Returns the silence that the protocol requires before a request (3.5 characters on Modbus RTU,
  /// Serial Line V1.02, 2.5.1.1). `char_time` is the time of one character; 0 if the speed of the
  /// line is unknown.
  virtual std::chrono::nanoseconds quiet_before(std::chrono::nanoseconds /*char_time*/) const {
    return {};
  }
  /// Returns the time after which the device itself abandons a request and answers with the reason.
  /// With a shorter timeout the caller receives neither data nor reason. 0 if there is no such
  /// time.
  virtual std::chrono::milliseconds gives_up_after() const { return {}; }
  /// Returns the pause after `request`, which has no answer (a broadcast), before the next request.
  virtual std::chrono::milliseconds pause_after(const Request& /*request*/) const { return {}; }

  // Recovery.

  /// Return the recovery that the line needs after a missing answer and after an invalid one.
  virtual Recovery after_silence() const { return Recovery::drain; }
  virtual Recovery after_nonsense() const { return Recovery::drain; }
  /// Returns the request that puts the line into a known state, if the protocol has one.
  virtual std::optional<Request> resync() const { return std::nullopt; }
  /// Number of consecutive probes whose answers can be distinguished.
  static constexpr std::uint32_t kProbes = 16;
  /// Returns a cheap read whose answer is not an ACK: the barrier after a lost answer. Probes whose
  /// numbers differ modulo kProbes have answers of different length, as far as the longest answer
  /// of the device has room for as many lengths.
  virtual std::optional<Request> probe(std::uint32_t /*number*/) const { return std::nullopt; }
  /// Returns the shortest read that any device behind this codec answers, even if with a refusal.
  /// It detects a device from which nothing else is read. nullopt if plc() has a request for this,
  /// or if no device would answer.
  virtual std::optional<Request> presence() const { return std::nullopt; }
  /// Returns the request for maker, product and version of a device. The image of its answer has
  /// them as printable ASCII, with commas between; it is empty if the device names nothing. nullopt
  /// if plc() identifies the device, or if the protocol has no such request.
  virtual std::optional<Request> identity() const { return std::nullopt; }
  /// Returns a read of less than `request`, with a shorter answer, so that the two answers cannot
  /// be confused. nullopt if `request` is not a read or cannot be shorter.
  virtual std::optional<Request> apart_from(const Request& /*request*/) const {
    return std::nullopt;
  }

  // Refusals.

  /// Returns the meaning of a refusal of `request` with this code (Reply::device_code). For a
  /// Gather, `hole` means that one of its parts was refused, or that there are too many; `final`
  /// means that the device lacks the command, and its places are read one by one afterwards.
  virtual RefusalMeaning meaning_of(const Request& request, int device_code) const = 0;
  /// True if a gateway sent this refusal because the device behind it does not answer. The meaning
  /// for a write does not show this: it only says if the write may have taken effect.
  bool is_from_gateway(int device_code) const {
    return meaning_of(Read{}, device_code) == RefusalMeaning::unreachable;
  }
  /// Returns another request with the same effect if `request` was refused because this device
  /// lacks its function (Modbus 06 → 16). nullopt if there is none.
  virtual std::optional<Request> instead_of(const Request& /*request*/, int /*device_code*/) const {
    return std::nullopt;
  }

  // Requests made of other requests.

  /// Returns one request that carries out all of `requests`, writes and forces, in one frame: a
  /// Scatter (BT, WT, QT; 04, 05; 1402). nullopt if there are fewer than two, if one is neither, or
  /// if no frame carries them.
  std::optional<Request> combine(const std::vector<Request>& requests) const;
  /// Returns the read that must come first if the device cannot carry out `request` directly.
  /// with_read() builds the request to send from its answer (read-modify-write).
  virtual std::optional<Request> read_before(const Request& /*request*/) const {
    return std::nullopt;
  }
  /// Returns the request to send after the read of read_before() has returned `image`. Returns
  /// `request` itself if no read was needed.
  virtual Request with_read(const Request& request, ByteView /*image*/) const { return request; }
};

}  // namespace fxagent
