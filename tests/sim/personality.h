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

enum class Protocol : std::uint8_t {
  programming_port,
  computer_link,
  modbus_rtu,
  modbus_ascii,
  modbus_tcp,
  mc_1e,
  mc_3e,
  mc_4e,
  mc_3c,
  mc_4c,
};
std::string_view protocol_name(Protocol protocol);
std::optional<Protocol> find_protocol(std::string_view name);
std::string protocol_names();
bool is_modbus(Protocol protocol);
/// 1E, 3E or 4E.
bool is_mc_ethernet(Protocol protocol);
/// 3C or 4C.
bool is_mc_serial(Protocol protocol);

enum class RequestKind : std::uint8_t {
  read,
  write,
  force_on,  // an order that sets one bit
  force_off,
  enquire,
  control,    // RUN, STOP, global signal
  handshake,  // the master's own ACK, NAK, EOT or CL: never answered, and no fault strikes it
  other,      // understood as a frame, but no device access
  malformed,  // no frame at all
};
inline constexpr std::size_t kRequestKinds = 9;
std::string request_kind_name(RequestKind kind);

/// What a framer has cut out of a line.
struct Frame {
  Bytes bytes;
  bool whole = true;   // false: bytes that belong to no frame
  TimePoint complete;  // when its last byte was off the wire
};

/// Puts a byte that belongs to no frame behind the ones before it.
void add_stray(std::uint8_t byte, TimePoint when, std::vector<Frame>& out);

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
  Bytes reply{};
  std::string why{};                    // of a NAK or of silence, for the log
  std::string device{};                 // first device, empty where none is meant
  unsigned count = 0;                   // devices of that kind
  std::vector<std::uint32_t> values{};  // written, raw; empty where a write cuts through a device
  std::chrono::milliseconds wait{0};    // the answer leaves no sooner after the end of the request
  unsigned points = 0;                  // asked for, in the request's own unit; MC only
};

/// What can be wrong with a reply that is otherwise as it should be.
enum class Flaw : std::uint8_t {
  sum,
  sender,
  transaction,
  length,        // FFFF in the length field
  length_short,  // one word less than there is
  length_long,   // one word more
  longer,        // one word of data more, and a length that says so
  shorter,
  end_code,  // of an error, ahead of the data
  header,    // of another kind of answer
};

class Personality {
 public:
  virtual ~Personality() = default;
  virtual Protocol protocol() const = 0;
  virtual std::unique_ptr<Framer> make_framer() const = 0;
  /// Is a whole frame meant for this station, alone or with others?
  virtual bool hears(const Frame& frame) const = 0;
  /// What the request is, told before anything is done; faults are matched with it.
  virtual RequestKind kind(const Frame& frame) const = 0;
  virtual Ruling execute(const Frame& frame, Plc& plc) const = 0;
  /// The answer of a station that refuses `frame` with `code`, or with what it usually says.
  virtual Bytes refusal(const Frame& frame, std::optional<std::uint16_t> code) const = 0;
  /// Puts the flaw into a reply; all else stays right. A reply without a sum gets another byte for
  /// a wrong one; what a protocol does not have is left alone.
  virtual void spoil(Bytes& reply, Flaw flaw) const = 0;
  /// What a gateway answers in the place of a station that does not.
  virtual Bytes nobody_there(const Frame&) const { return {}; }
  /// The command by its number, for counting; empty where a protocol's kinds tell enough.
  virtual std::string command(const Frame&) const { return {}; }
};

}  // namespace fxsim
