// The port of this room: what a protocol must be able to say about its wire and its devices.
// A codec is a value: made once per device from its options, const afterwards, no state, no clock.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "protocol/bytes.h"
#include "protocol/point.h"
#include "protocol/result.h"

namespace fxagent {

// ---- requests and replies -------------------------------------------------------------------

/// "Are you there?" Also puts the device's receiver into a known state (programming port: ENQ).
struct Enquire {
  friend bool operator==(const Enquire&, const Enquire&) = default;
};
/// Reads `bits` bits of a space by one of the ways the codec offers (ReadWay::way).
struct Read {
  Span span;
  std::uint8_t way = 0;
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
/// What a protocol has beside memory access; which of them exist is the codec's to say.
struct Control {
  enum class Kind : std::uint8_t { identify, run, stop, reset } kind = Kind::identify;
  friend bool operator==(const Control&, const Control&) = default;
};

using Request = std::variant<Enquire, Read, Write, Force, Control, Scatter>;

struct Reply {
  enum class Kind : std::uint8_t { ack, nak, data } kind = Kind::ack;
  Bytes image;               ///< data: the image of the request's span (or what identify brought)
  int device_code = 0;       ///< nak: the reason, 0 where the protocol gives none
  std::string text;          ///< nak: the reason in words ("nak 06: device does not exist")
  Bytes closing;             ///< to be sent after this reply without waiting for an answer
  std::size_t began = 0;     ///< bytes of rx before the reply's frame: an echo, or older
  std::size_t consumed = 0;  ///< bytes of rx up to the end of the reply; more are not its own
};

// ---- what the planner needs to know ---------------------------------------------------------

/// One way to read part of a space. A read by it starts at a multiple of `align_bits` from the
/// space's start, is a multiple of `unit_bits` long, at most `max_bits`, inside [first_bit,
/// end_bit).
struct ReadWay {
  std::uint8_t way = 0;  ///< goes into Read::way
  std::uint8_t tier =
      0;  ///< a point takes a way of the lowest tier that reaches it; tiers never mix
  std::uint32_t first_bit = 0;
  std::uint32_t end_bit = 0;
  std::uint32_t align_bits = 8;
  std::uint32_t unit_bits = 8;
  std::uint32_t max_bits = 512;
  std::uint32_t max_gap_bits =
      0xFFFFFFFF;  ///< bits that nobody asked for, at most so many in a row
};

/// Characters on the line in each direction for one exchange that ends well.
struct LineLength {
  std::uint32_t request_chars = 0;
  std::uint32_t reply_chars = 0;
  std::uint32_t closing_chars = 0;
};

// ---- a frame explained, for `fxagent decode` --------------------------------------------------

enum class Direction : std::uint8_t { request, reply };

struct Explanation {
  bool ok = false;
  Direction direction = Direction::request;
  bool ambiguous = false;              ///< the bytes are a good frame in both directions
  std::string operation;               ///< read write force_on force_off enquire ack nak data other
  std::optional<std::string> command;  ///< "0", "E00", "BR", "03" …
  std::optional<std::string> command_set;  ///< "classic" or "extended"
  std::optional<std::string> device;       ///< head device in the manual's words
  std::optional<std::uint32_t> count;      ///< devices of that kind: words, or bits
  std::vector<std::string> values;         ///< words as 4 hex digits, bits as 0/1
  std::optional<std::string> checksum_given;
  std::optional<std::string> checksum_computed;
  std::optional<std::string> error;  ///< why it is not a good frame
  std::vector<std::pair<std::string, std::string>>
      fields;  ///< name and meaning of each part, in order
};

// ---- what went wrong ---------------------------------------------------------------------------

/// What a device's no tells about the order and about the device.
enum class RefusalMeaning : std::uint8_t {
  final,        ///< surely no effect, and a repeat would change nothing
  curable,      ///< surely no effect, and a repeat may succeed
  busy,         ///< as curable, after a pause
  hole,         ///< a read touched something that this device lacks: ask for less
  unclear,      ///< a write may have been carried out all the same: like silence
  unreachable,  ///< a gateway speaks: the unit behind it gave no answer
};

enum class Recovery : std::uint8_t {
  drain,      ///< wait until the line is quiet, then resync()
  none,       ///< answers carry numbers, so a late one cannot be mistaken
  reconnect,  ///< the stream has lost its frames: only a new connection helps
};

// ---- the port ---------------------------------------------------------------------------------

class Codec {
 public:
  virtual ~Codec() = default;

  // Names and places.

  /// Reads an address as the engineer writes it. `type` decides where a name has two meanings
  /// (T5: contact as bool, else value); without it such a name means the value.
  /// bad_request: not a name of this protocol, or a number the model lacks; the text says which
  /// range is right.
  virtual Result<Address> parse_address(std::string_view text,
                                        std::optional<DataType> type) const = 0;
  /// True where `text` needs a type to be told apart in a command (T5, C5).
  virtual bool needs_type(std::string_view text) const = 0;
  /// A range for an allow list: "M100-M199" or one device. bad_request as parse_address; the ends
  /// are of two kinds; T or C without N or S; or it holds what is never written (M8034-M8037,
  /// M8118).
  virtual Result<Span> parse_range(std::string_view text) const = 0;
  /// Whether every device of `span` exists in this model; bad_request names the first that does
  /// not.
  virtual Result<void> check_range(const Span& span) const = 0;
  /// Whether `span` may be written at all and in this shape: bad_request where it would overwrite
  /// bits beside it (half bytes), or touches what is never written (M8034-M8037, M8118).
  virtual Result<void> check_write(const Span& span) const = 0;

  // What a point can be, and how it is fetched.

  /// The device's words for `span`'s first device ("D100").
  virtual std::string name_of(const Span& span) const = 0;
  /// The space's ways, best first. Empty where this model has no such space.
  virtual std::vector<ReadWay> read_ways(std::uint16_t space) const = 0;
  /// The most bits of `span`'s space that one Write may carry.
  virtual std::uint32_t max_write_bits(std::uint16_t space) const = 0;
  virtual ByteOrder default_order() const = 0;

  // Bytes.

  /// The frame for a request. `tag` numbers the exchange where the protocol has a field for it.
  /// unsupported: this model or protocol cannot say it. bad_request: out of the limits above.
  virtual Result<Bytes> encode(const Request& request, std::uint16_t tag) const = 0;
  /// nullopt: need more bytes. Sees everything received since the request was sent. bad_frame: what
  /// came cannot become an answer. A refusal is a Reply with Kind::nak, not an error.
  virtual Result<std::optional<Reply>> decode(const Request& request, std::uint16_t tag,
                                              ByteView rx) const = 0;
  /// False where no answer is to be awaited (EOT, a broadcast).
  virtual bool expects_reply(const Request& request) const = 0;
  virtual LineLength line_length(const Request& request) const = 0;
  /// One frame explained; without a direction the likelier one is taken.
  virtual Explanation explain(ByteView frame, std::optional<Direction> direction) const = 0;

  // The device itself.

  /// What brings the line into a known state, if the protocol has such a thing.
  virtual std::optional<Request> resync() const = 0;
  /// A cheap read whose answer no other answer can be taken for; the barrier behind a lost ACK.
  virtual std::optional<Request> probe() const = 0;
  /// The reads that tell the model, in order; empty where the protocol has no way to ask.
  virtual std::vector<Request> identify() const = 0;
  /// The model's name from the answers of identify() (refused ones are left empty); nullopt where
  /// they do not tell it.
  virtual std::optional<std::string> model_from(const std::vector<Bytes>& images) const = 0;
  /// The configured or identified model; empty while it is unknown.
  virtual std::string model() const = 0;
  /// This codec for a model found by asking; never null for a name that model_from() returned.
  virtual std::shared_ptr<const Codec> with_model(std::string_view model) const = 0;
  /// Reads whether the PLC runs; nullopt where the protocol cannot tell.
  virtual std::optional<Request> run_state() const = 0;
  virtual std::optional<bool> run_state_from(ByteView image) const = 0;
  /// The order that starts (true) or stops the PLC. unsupported where the protocol has none.
  virtual Result<Request> run_order(bool run) const = 0;
  /// For a person whose run or stop failed: the switch position that this protocol needs.
  virtual std::string run_order_hint() const = 0;
  /// What a refusal of `request` with this code means.
  virtual RefusalMeaning meaning_of(const Request& request, int device_code) const = 0;
  /// Another request with the same effect, where `request` was refused because this device lacks
  /// its function (Modbus 06 → 16); nullopt where there is none.
  virtual std::optional<Request> instead_of(const Request& /*request*/, int /*device_code*/) const {
    return std::nullopt;
  }

  // What a protocol may have beyond one question at a time on a quiet line.

  /// One request that carries out all of `requests` in one frame (BT, WT); nullopt where none can.
  virtual std::optional<Request> combine(const std::vector<Request>& /*requests*/) const {
    return std::nullopt;
  }
  /// A read that must come first, where the device cannot do `request` by itself: with_read() makes
  /// of its answer the request to send (read-modify-write).
  virtual std::optional<Request> read_before(const Request& /*request*/) const {
    return std::nullopt;
  }
  virtual Request with_read(const Request& request, ByteView /*image*/) const { return request; }
  /// Silence that the protocol demands before a request (3.5 characters on Modbus RTU).
  virtual std::chrono::nanoseconds quiet_before(std::chrono::nanoseconds /*char_time*/) const {
    return {};
  }
  /// How long nothing may be asked after `request`, which is not answered (a broadcast).
  virtual std::chrono::milliseconds pause_after(const Request& /*request*/) const { return {}; }
  /// Whether bytes that nobody asked for could be an answer, whole or in part, to whatever is
  /// asked next; or another master's. What no answer can be made of is noise.
  virtual bool may_pass_for_answer(ByteView bytes) const { return !bytes.empty(); }
  /// A read of less than `request` reads, whose answer is shorter, so that neither answer can be
  /// taken for the other's. nullopt: `request` is no read, or its least.
  virtual std::optional<Request> apart_from(const Request& /*request*/) const {
    return std::nullopt;
  }
  /// True where every device listens and none answers: no tags, and no outcome but `broadcast`.
  virtual bool is_broadcast() const { return false; }
  /// What must be done with the line after an answer that did not come, or was nonsense.
  virtual Recovery after_silence() const { return Recovery::drain; }
  virtual Recovery after_nonsense() const { return Recovery::drain; }
};

}  // namespace fxagent
