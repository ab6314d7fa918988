// The interface between a line and the protocol on it. A protocol splits the bytes of a line into
// requests (Framer) and carries out a request on a PLC (Personality). Neither handles time on the
// wire, faults or logs: those belong to Line and Station.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
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
  force_on,  // a command that sets one bit
  force_off,
  enquire,
  control,    // RUN, STOP, global signal
  handshake,  // the master's own ACK, NAK, EOT or CL: never answered; faults ignore it
  other,      // a valid frame without device access
  malformed,  // not a frame
};
inline constexpr std::size_t kRequestKinds = 9;
std::string request_kind_name(RequestKind kind);

/// Bytes that a framer extracted from a line.
struct Frame {
  Bytes bytes;
  bool whole = true;   // false: bytes outside of any frame
  TimePoint complete;  // when its last byte was complete on the wire
};

/// Appends a byte outside of any frame to the stray bytes before it.
void add_stray(std::uint8_t byte, TimePoint when, std::vector<Frame>& out);

/// Cuts one direction of one line into frames. Keeps state between bytes.
class Framer {
 public:
  virtual ~Framer() = default;
  /// Takes the byte that was complete on the wire at `when` and adds every frame it completes to
  /// `out`. Bytes outside of any frame are appended to the stray bytes before them in `out`.
  virtual void take(std::uint8_t byte, TimePoint when, std::vector<Frame>& out) = 0;

 protected:
  /// Adds the collected bytes, the last of which was complete at `when`, as a frame.
  void finish(bool whole, TimePoint when, std::vector<Frame>& out) {
    out.push_back({std::exchange(frame_, {}), whole, when});
  }
  /// The same for a frame that was not completed; adds nothing if no bytes are collected.
  void give_up(std::vector<Frame>& out) {
    if (!frame_.empty()) finish(false, last_, out);
  }

  Bytes frame_;        // collected so far
  TimePoint last_{};   // when the last byte was complete, for protocols with time limits
  bool lost_ = false;  // the rest of the connection is unreadable
};

enum class Verdict : std::uint8_t { data, ack, nak, silent };
std::string verdict_name(Verdict verdict);

/// The PLC's response to one request.
struct Ruling {
  Verdict verdict = Verdict::silent;
  Bytes reply{};
  std::string why{};                    // reason for a NAK or silence, for the log
  std::string device{};                 // first device; empty if there is none
  unsigned count = 0;                   // number of devices
  std::vector<std::uint32_t> values{};  // written, raw; empty if a write covers part of a device
  std::chrono::milliseconds wait{0};    // minimum time from the end of the request to the answer
  unsigned points = 0;                  // requested, in the request's own unit; MC only
};

/// A single flaw in an otherwise correct reply.
enum class Flaw : std::uint8_t {
  sum,
  sender,
  transaction,
  length,        // FFFF in the length field
  length_short,  // one word less than the data
  length_long,   // one word more than the data
  longer,        // one extra word of data and a matching length
  shorter,
  end_code,  // an error's end code before the data
  header,    // of another kind of reply
};

class Personality {
 public:
  virtual ~Personality() = default;
  virtual Protocol protocol() const = 0;
  virtual std::unique_ptr<Framer> make_framer() const = 0;
  /// True if a whole frame is addressed to this station, alone or with others.
  virtual bool hears(const Frame& frame) const = 0;
  /// Classifies a request without carrying it out; faults are matched by kind.
  virtual RequestKind kind(const Frame& frame) const = 0;
  virtual Ruling execute(const Frame& frame, Plc& plc) const = 0;
  /// The answer of a station that refuses `frame` with `code`, or with its usual code.
  virtual Bytes refusal(const Frame& frame, std::optional<std::uint16_t> code) const = 0;
  /// Applies the flaw to a reply and keeps everything else correct. For a wrong sum, a reply
  /// without a sum gets one wrong byte. A flaw the protocol does not have changes nothing.
  virtual void spoil(Bytes& reply, Flaw flaw) const = 0;
  /// A gateway's answer on behalf of a station that does not answer.
  virtual Bytes nobody_there(const Frame&) const { return {}; }
  /// The command's number, for counting; empty for protocols whose kinds are sufficient.
  virtual std::string command(const Frame&) const { return {}; }
};

}  // namespace fxsim
