// The wire format of one device: the bytes of requests and answers, their timing, and the recovery
// after a missing answer. address_space.h describes the memory behind it, plc.h the PLC itself; a
// codec gives access to both. A codec is a value: made once per device from its options, const
// afterwards, without state or clock. Any thread.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <vector>

#include "protocol/address_space.h"
#include "protocol/explanation.h"
#include "protocol/request.h"
#include "protocol/value/bytes.h"
#include "protocol/value/result.h"

namespace fxagent {

class PlcServices;

/// A protocol defines addresses(), encode(), decode(), explain(), line_length() and meaning_of().
/// It overrides another function only if it differs from the default.
class Codec {
 public:
  virtual ~Codec() = default;

  /// Returns names, ranges and limits of the memory; valid as long as the codec.
  virtual const AddressSpace& addresses() const = 0;
  /// Returns the services for the PLC itself; valid as long as the codec. nullptr: there are none.
  virtual const PlcServices* plc() const { return nullptr; }

  // ---- one exchange

  /// Returns the frame for a request. `tag` numbers the exchange if the protocol has a field for
  /// it. Errors: unsupported (not possible with this model or protocol), bad_request (outside the
  /// limits of addresses()).
  virtual Result<Bytes> encode(const Request& request, std::uint16_t tag) const = 0;
  /// False if the request has no answer (EOT, a broadcast).
  virtual bool expects_reply(const Request& /*request*/) const { return !is_broadcast(); }
  /// Returns the pause after a request without an answer, before the next request.
  virtual std::chrono::milliseconds pause_after(const Request& /*request*/) const { return {}; }
  /// Finds the answer in `rx`: all bytes since the frame of encode(), without the line's echo; of
  /// datagrams only the last one. Call only if expects_reply(). nullopt: more bytes are needed. A
  /// refusal is a Reply with Kind::nak, not an error. Error: bad_frame if the bytes cannot become
  /// an answer.
  virtual Decoded decode(const Request& request, std::uint16_t tag, ByteView rx) const = 0;
  /// Returns the characters of one successful exchange. The planner relies on this: a part adds the
  /// same length to a Gather whatever its other parts are.
  virtual LineLength line_length(const Request& request) const = 0;

  // ---- the device and its line

  /// True if every device listens and none answers: no tags, and the only outcome is `broadcast`.
  virtual bool is_broadcast() const { return false; }
  /// True if frames are text: digits and letters between control characters, none of which needs an
  /// eighth bit.
  virtual bool is_text() const { return false; }
  /// Explains one frame. Without a direction it assumes the likelier one. Accepts any bytes; the
  /// explanation's `error` states what is wrong with them.
  virtual Explanation explain(ByteView frame, std::optional<Direction> direction) const = 0;
  /// Returns the silence that the protocol requires before a request (3.5 characters on Modbus RTU,
  /// Serial Line V1.02, 2.5.1.1). `char_time` is the time of one character; 0: unknown.
  virtual std::chrono::nanoseconds quiet_before(std::chrono::nanoseconds /*char_time*/) const {
    return {};
  }
  /// Returns the time after which the device itself abandons a request and answers with the reason;
  /// 0: never. With a shorter timeout the caller receives neither data nor reason.
  virtual std::chrono::milliseconds gives_up_after() const { return {}; }
  /// Returns the shortest read that any device behind this codec answers, even if with a refusal.
  /// It detects a device from which nothing else is read. nullopt if plc() has a request for this,
  /// or if no device would answer.
  virtual std::optional<Request> presence() const { return std::nullopt; }
  /// Returns the request for maker, product and version of a device. The image of its answer has
  /// them as printable ASCII, with commas between; it is empty if the device names nothing. nullopt
  /// if plc() identifies the device, or if the protocol has no such request.
  virtual std::optional<Request> identity() const { return std::nullopt; }

  // ---- after a missing or invalid answer: no older answer may pass for the next one

  /// Return the recovery that the line needs after a missing answer and after an invalid one.
  virtual Recovery after_silence() const { return Recovery::drain; }
  virtual Recovery after_nonsense() const { return Recovery::drain; }
  /// Returns the request that puts the line into a known state, if the protocol has one.
  virtual std::optional<Request> resync() const { return std::nullopt; }
  /// True if unrequested bytes could be all or part of an answer to the next request, whatever it
  /// is, or come from another master. Bytes that cannot form an answer are noise.
  virtual bool may_pass_for_answer(ByteView bytes) const { return !bytes.empty(); }
  /// Returns a probe: a cheap read, not answered by an ACK. Its answer shows that no older one is
  /// on its way any more. Probes whose numbers differ modulo kProbes have answers of different
  /// length, as far as the longest answer of the device has room for as many lengths.
  virtual std::optional<Request> probe(std::uint32_t /*number*/) const { return std::nullopt; }
  static constexpr std::uint32_t kProbes = 16;
  /// Returns a read of less than `request`, with a shorter answer, so that the two answers cannot
  /// be confused. nullopt if `request` is not a read or cannot be shorter.
  std::optional<Request> shorter_read(const Request& request) const;

  // ---- refusals

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

  // ---- requests made of others

  /// Returns one request that carries out all of `requests`, writes and forces, in one frame: a
  /// Scatter (BT, WT, QT; 04, 05; 1402). nullopt if there are fewer than two, if one is neither, or
  /// if no frame carries them.
  std::optional<Request> combine(const std::vector<Request>& requests) const;
  /// Returns the read that must come first if the device cannot carry out `request` directly
  /// (read-modify-write). with_read() then returns the request to send, made from its image;
  /// `request` itself if no read was needed.
  virtual std::optional<Request> read_before(const Request& /*request*/) const {
    return std::nullopt;
  }
  virtual Request with_read(const Request& request, ByteView /*image*/) const { return request; }

 protected:
  /// Returns the bits by which shorter_read() shortens the read; 0: it cannot.
  virtual std::uint32_t shorter_by(const Read& /*read*/) const { return 0; }
};

}  // namespace fxagent
