// What a protocol says about its wire: the bytes of requests and answers, how long they take, and
// what is to be done where one did not come. The memory behind them is address_space.h, the PLC
// itself is plc.h; a codec leads to both.
// A codec is a value: made once per device from its options, const afterwards, no state, no clock.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "protocol/address_space.h"
#include "protocol/bytes.h"
#include "protocol/point.h"
#include "protocol/result.h"

namespace fxagent {

class PlcServices;

// ---- requests and replies -------------------------------------------------------------------

/// "Are you there?" Also puts the device's receiver into a known state (programming port: ENQ).
struct Enquire {
  friend bool operator==(const Enquire&, const Enquire&) = default;
};
/// Reads `bits` bits of a space by one of the ways that its address space offers (ReadWay::way).
struct Read {
  Span span;
  std::uint8_t way = 0;
  std::uint8_t gather = 0;  ///< ReadWay::gather of that way: not 0 only in a part of a Gather
  friend bool operator==(const Read&, const Read&) = default;
};
/// Overwrites whole units of a space; `image` covers exactly `span`. `way` 0 is the codec's first
/// choice of function, others are those of instead_of().
struct Write {
  Span span;
  Bytes image;
  std::uint8_t way = 0;
  friend bool operator==(const Write&, const Write&) = default;
};
/// Sets or clears a single bit without touching its neighbours.
struct Force {
  std::uint16_t space = 0;
  std::uint32_t bit = 0;
  bool on = false;
  std::uint8_t way = 0;  ///< as in Write
  friend bool operator==(const Force&, const Force&) = default;
};
/// Several writes that one frame carries to scattered places; bits have spans of one bit.
struct Scatter {
  std::vector<Write> parts;
  friend bool operator==(const Scatter&, const Scatter&) = default;
};
/// Several reads that one frame carries from scattered places, at least one: all by the same
/// GatherCommand, in any order. The image of its reply is that of one part behind the other, in the
/// order of the parts, each beginning with a whole byte.
struct Gather {
  std::vector<Read> parts;
  friend bool operator==(const Gather&, const Gather&) = default;
};
/// What a protocol has beside memory access: a reset of the line, and services of plc.h.
struct Control {
  enum class Kind : std::uint8_t { identify, run, stop, reset } kind = Kind::identify;
  friend bool operator==(const Control&, const Control&) = default;
};

using Request = std::variant<Enquire, Read, Write, Force, Control, Scatter, Gather>;

/// Whether it is answered by data alone, never by an ACK.
inline bool is_read(const Request& request) {
  return std::holds_alternative<Read>(request) || std::holds_alternative<Gather>(request);
}

/// What came back to a request.
struct Reply {
  enum class Kind : std::uint8_t { ack, nak, data } kind = Kind::ack;
  Bytes image;               ///< data: the image of the request's span (or what identify brought)
  int device_code = 0;       ///< nak: the reason, 0 where the protocol gives none
  std::string text;          ///< nak: the reason in words ("nak 06: device does not exist")
  Bytes closing;             ///< to be sent after this reply without waiting for an answer
  std::size_t began = 0;     ///< bytes of rx before the reply's frame: an echo, or older
  std::size_t consumed = 0;  ///< bytes of rx up to the end of the reply; more are not its own
};

// ---- how long it takes --------------------------------------------------------------------------

/// Characters on the line in each direction for one exchange that ends well.
struct LineLength {
  std::uint32_t request_chars = 0;
  std::uint32_t reply_chars = 0;
  std::uint32_t closing_chars = 0;
  /// What a reply may have more where its values decide, as bytes that are doubled on the wire: for
  /// deadlines and bounds. Plans reckon without it.
  std::uint32_t more_reply_chars = 0;
  /// How many characters of the request and of the reply only double another one, as an address or
  /// a length decides. Plans reckon without them, too: a read costs what its length says, wherever
  /// it is.
  std::uint32_t doubled_chars = 0;

  /// Those that a plan reckons with, in all directions.
  std::uint32_t planned_chars() const {
    return request_chars + reply_chars + closing_chars - doubled_chars;
  }
};

// ---- a frame explained, for `fxagent decode` --------------------------------------------------

/// Which way a frame went: to the device, or back.
enum class Direction : std::uint8_t { request, reply };

/// What `fxagent decode` prints of one frame; optional parts are those that this frame has.
struct Explanation {
  bool ok = false;
  Direction direction = Direction::request;
  bool ambiguous = false;              ///< the bytes are a good frame in both directions
  std::string operation;               ///< read write force_on force_off enquire ack nak data other
  std::optional<std::string> command;  ///< "0", "E00", "BR", "03" …
  std::optional<std::string> command_set;  ///< "classic" or "extended"
  std::optional<std::uint32_t> format;     ///< where the protocol has several around one content
  /// Head device in the manual's words; of a scattered write all of them: "M50,S100,Y1".
  std::optional<std::string> device;
  std::optional<std::uint32_t> count;  ///< devices of that kind: words, or bits
  std::vector<std::string> values;     ///< words as 4 hex digits, bits as 0/1
  std::optional<std::string> checksum_given;
  std::optional<std::string> checksum_computed;
  std::optional<std::string> error;  ///< why it is not a good frame
  std::vector<std::pair<std::string, std::string>>
      fields;  ///< name and meaning of each part, in order
};

// ---- what went wrong ---------------------------------------------------------------------------

/// What a device's no tells about the request and about the device.
enum class RefusalMeaning : std::uint8_t {
  final,        ///< surely no effect, and a repeat would change nothing
  curable,      ///< surely no effect, and a repeat may succeed
  busy,         ///< as curable, after a pause
  hole,         ///< a read touched something that this device lacks: ask for less
  unclear,      ///< a write may have been carried out all the same: like silence
  unreachable,  ///< a gateway speaks: the unit behind it gave no answer
};

/// What a line needs before its next request.
enum class Recovery : std::uint8_t {
  drain,      ///< wait until the line is quiet, then resync()
  none,       ///< answers carry numbers, so a late one cannot be mistaken
  reconnect,  ///< the stream has lost its frames: only a new connection helps
};

// ---- the port ---------------------------------------------------------------------------------

/// The bytes of one device's line. Sources are those of the protocol, in protocol/README.md.
class Codec {
 public:
  virtual ~Codec() = default;

  // What lies behind the bytes.

  /// Names, ranges and limits of the memory; valid as long as the codec.
  virtual const AddressSpace& addresses() const = 0;
  /// What can be done with the PLC itself; valid as long as the codec. nullptr where the protocol
  /// has no such services.
  virtual const PlcServices* plc() const { return nullptr; }

  // Bytes.

  /// The frame for a request. `tag` numbers the exchange where the protocol has a field for it.
  /// unsupported: this model or protocol cannot say it. bad_request: out of the limits of
  /// addresses().
  virtual Result<Bytes> encode(const Request& request, std::uint16_t tag) const = 0;
  /// nullopt: need more bytes. Sees everything received since the request was sent. bad_frame: what
  /// came cannot become an answer. A refusal is a Reply with Kind::nak, not an error.
  virtual Result<std::optional<Reply>> decode(const Request& request, std::uint16_t tag,
                                              ByteView rx) const = 0;
  /// False where no answer is to be awaited (EOT, a broadcast).
  virtual bool expects_reply(const Request& request) const = 0;
  /// True where every device listens and none answers: no tags, and no outcome but `broadcast`.
  virtual bool is_broadcast() const { return false; }
  /// Whether bytes that nobody asked for could be an answer, whole or in part, to whatever is
  /// asked next; or another master's. What no answer can be made of is noise.
  virtual bool may_pass_for_answer(ByteView bytes) const { return !bytes.empty(); }
  /// Whether its frames are text: digits and letters between control characters, none of which
  /// needs an eighth bit.
  virtual bool is_text() const { return false; }
  /// One frame explained; without a direction the likelier one is taken.
  virtual Explanation explain(ByteView frame, std::optional<Direction> direction) const = 0;

  // Timing.

  /// Characters of one exchange of `request` that ends well. What a part adds to a Gather depends
  /// on that part alone, not on the others: so the planner reckons.
  virtual LineLength line_length(const Request& request) const = 0;
  /// Silence that the protocol demands before a request (3.5 characters on Modbus RTU, Serial Line
  /// V1.02, 2.5.1.1); `char_time` is that of one character, 0 where the line's speed is not known.
  virtual std::chrono::nanoseconds quiet_before(std::chrono::nanoseconds /*char_time*/) const {
    return {};
  }
  /// After how long the device itself gives a request up, and answers with the reason: who waits
  /// less than that hears neither. 0 where it has no such time.
  virtual std::chrono::milliseconds gives_up_after() const { return {}; }
  /// How long nothing may be asked after `request`, which is not answered (a broadcast).
  virtual std::chrono::milliseconds pause_after(const Request& /*request*/) const { return {}; }

  // Recovery.

  /// What must be done with the line after an answer that did not come, or was nonsense.
  virtual Recovery after_silence() const { return Recovery::drain; }
  virtual Recovery after_nonsense() const { return Recovery::drain; }
  /// What brings the line into a known state, if the protocol has such a thing.
  virtual std::optional<Request> resync() const { return std::nullopt; }
  /// So many probes in a row have answers that can be told apart.
  static constexpr std::uint32_t kProbes = 16;
  /// A cheap read whose answer is no ACK; the barrier behind a lost one. Probes of other numbers
  /// (modulo kProbes) have answers of other lengths.
  virtual std::optional<Request> probe(std::uint32_t /*number*/) const { return std::nullopt; }
  /// The shortest read that any device behind this codec answers, if only with a refusal: it shows
  /// that a device is there of which nothing else is read. nullopt: plc() has the question for it,
  /// or nobody would answer.
  virtual std::optional<Request> presence() const { return std::nullopt; }
  /// A read of less than `request` reads, whose answer is shorter, so that neither answer can be
  /// taken for the other's. nullopt: `request` is no read, or its least.
  virtual std::optional<Request> apart_from(const Request& /*request*/) const {
    return std::nullopt;
  }

  // Refusals.

  /// What a refusal of `request` with this code (Reply::device_code) means. Of a Gather `hole`: one
  /// of its parts, or too many of them; `final`: this device lacks the command, and its places are
  /// read one by one from then on.
  virtual RefusalMeaning meaning_of(const Request& request, int device_code) const = 0;
  /// Another request with the same effect, where `request` was refused because this device lacks
  /// its function (Modbus 06 → 16); nullopt where there is none.
  virtual std::optional<Request> instead_of(const Request& /*request*/, int /*device_code*/) const {
    return std::nullopt;
  }

  // One request made of others.

  /// One request that carries out all of `requests` in one frame: a Scatter of writes and forces
  /// (BT, WT), a Gather of reads; nullopt where none can.
  virtual std::optional<Request> combine(const std::vector<Request>& /*requests*/) const {
    return std::nullopt;
  }
  /// A read that must come first, where the device cannot do `request` by itself: with_read() makes
  /// of its answer the request to send (read-modify-write).
  virtual std::optional<Request> read_before(const Request& /*request*/) const {
    return std::nullopt;
  }
  /// The request to send once the read of read_before() has brought `image`; `request` itself where
  /// none was needed.
  virtual Request with_read(const Request& request, ByteView /*image*/) const { return request; }
};

}  // namespace fxagent
