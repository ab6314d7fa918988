// The port between a line and what speaks on it. A protocol splits the bytes of a line into
// requests (Framer) and carries a request out on a PLC (Personality). Neither knows about time
// on the wire, faults or logs: those belong to Line and Station.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "tests/sim/bytes.h"
#include "tests/sim/plc.h"

namespace fxsim {

enum class RequestKind : std::uint8_t {
  read,
  write,
  force_on,
  force_off,
  enquire,
  other,      // understood as a frame, but no device access
  malformed,  // no frame at all
};
inline constexpr std::size_t kRequestKinds = 7;
std::string request_kind_name(RequestKind kind);

/// What a framer has cut out of a line.
struct Frame {
  Bytes bytes;
  bool whole = true;   // false: bytes that belong to no frame
  TimePoint complete;  // when its last byte was off the wire
};

/// Cuts one direction of one line into frames. Keeps state between bytes.
class Framer {
 public:
  virtual ~Framer() = default;
  /// Takes the byte that was complete on the wire at `when`; adds what it completes to `out`. Bytes
  /// outside of any frame join the ones before them in `out`.
  virtual void take(std::uint8_t byte, TimePoint when, std::vector<Frame>& out) = 0;
};

enum class Verdict : std::uint8_t { data, ack, nak, silent };
std::string verdict_name(Verdict verdict);

/// What a PLC made of one request.
struct Ruling {
  Verdict verdict = Verdict::silent;
  Bytes reply;
  std::string why;                    // of a NAK or of silence, for the log
  std::string device;                 // first device, empty where none is meant
  unsigned count = 0;                 // devices of that kind
  std::vector<std::uint32_t> values;  // written, raw; empty where a write cuts through a device
};

class Personality {
 public:
  virtual ~Personality() = default;
  virtual std::unique_ptr<Framer> make_framer() const = 0;
  /// What the request is, told before anything is done; faults are matched with it.
  virtual RequestKind kind(const Frame& frame) const = 0;
  virtual Ruling execute(const Frame& frame, Plc& plc) const = 0;
  /// The answer of a PLC that refuses without a reason.
  virtual Bytes refusal() const = 0;
  /// Makes the check of a reply wrong. A reply without one gets another byte.
  virtual void spoil_sum(Bytes& reply) const = 0;
};

}  // namespace fxsim
