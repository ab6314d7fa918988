// Injected faults: the requests they match and their effect on the reply.
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <optional>
#include <random>
#include <string>
#include <string_view>
#include <vector>

#include "tests/sim/personality.h"

namespace fxsim {

enum class FaultKind : std::uint8_t {
  nak,                  // refused, not carried out
  wrong_sum,            // carried out, reply with a wrong checksum
  truncated,            // carried out, reply ends early
  late,                 // carried out at once, answered late
  silent,               // not carried out, no answer
  execute_then_silent,  // carried out, no answer
  garbage_before,       // other bytes before the reply
  noise_after,          // other bytes after the reply
  echo,                 // the request is echoed before the reply
  split,                // the reply arrives in pieces with pauses
  drop,                 // not carried out, connection closed
  plc_stopped,          // the PLC goes to STOP, then answers as usual
  dead,                 // the station is silent until the fault is cleared
  exception,            // nak under its Modbus name
  wrong_station,        // carried out, reply appears to come from another station
  wrong_unit,           // wrong_station under its Modbus name
  wrong_id,             // carried out, reply has the previous transaction id
  bad_length,           // carried out, the reply's length field is nonsense
  length_short,         // carried out, the reply's length field is one word too small
  length_long,          // carried out, the reply's length field is one word too large
  longer,               // carried out, one extra word of data and a matching length
  shorter,              // carried out, one word of data missing and a matching length
  end_code_with_data,   // carried out, the reply has an error's end code
  wrong_header,         // carried out, reply has the header of another frame or command
  twice,                // carried out, the reply is sent twice
  overtaken,            // carried out, answered late; later requests are answered first
  coalesced,            // carried out, the reply is sent together with the next one
  from_elsewhere,       // carried out, the datagram is sent from another port
  asked_twice,  // carried out and answered twice, as if the network had duplicated the request
};
inline constexpr std::size_t kFaultKinds = 29;
std::string_view fault_name(FaultKind kind);
std::optional<FaultKind> find_fault(std::string_view name);
std::string fault_names();

enum class FaultMatch : std::uint8_t { any, read, write, force, enquire, control, other };
std::optional<FaultMatch> find_match(std::string_view name);
std::string match_names();

struct Fault {
  FaultKind kind = FaultKind::nak;
  FaultMatch match = FaultMatch::any;
  int count = 1;  // number of strikes; -1: until cleared
  int every = 1;  // strikes only every n-th matching request
  double probability = 1.0;
  std::uint32_t seed = 1;
  // late, overtaken: delay of the reply; split: pause between pieces; twice: pause between the
  // copies; drop: duration of the outage
  std::chrono::milliseconds delay{0};
  std::size_t bytes = 0;  // truncated: bytes that are sent, 0 = half; split: size of a piece
  Bytes other{};          // garbage_before and noise_after: the bytes to send
  std::optional<std::uint16_t> code{};  // nak and exception; nullopt: the protocol's usual code
};

/// The combined effect on one exchange of all faults that struck.
struct Treatment {
  enum class Reply : std::uint8_t { as_ruled, refusal, none };
  struct Cut {
    std::size_t bytes;
    std::chrono::milliseconds pause;
  };

  bool execute = true;
  Reply reply = Reply::as_ruled;
  bool stop_plc = false;
  std::optional<std::uint16_t> code;  // of the refusal
  std::vector<Flaw> flaws;
  bool echo = false;
  bool dead = false;
  std::optional<std::size_t> truncated_to;
  std::optional<Cut> split;
  std::optional<std::chrono::milliseconds> drop;  // duration of the outage
  std::optional<std::chrono::milliseconds> twice;
  std::optional<std::chrono::milliseconds> overtaken;
  bool coalesced = false;
  bool from_elsewhere = false;
  bool asked_twice = false;
  std::chrono::milliseconds delay{0};
  Bytes before;
  Bytes after;
  std::vector<FaultKind> struck;
};

/// The pending faults of one station.
class Faults final {
 public:
  void add(const Fault& fault);
  void clear() { waiting_.clear(); }
  /// True if the line must be silent now, even in the middle of a reply.
  bool dead() const;
  /// Counts a request and selects the faults that strike it. Call once per whole request, in the
  /// order of arrival.
  Treatment treat(RequestKind request);

 private:
  struct Waiting {
    Fault fault;
    std::mt19937 random;
    int seen = 0;
  };
  std::vector<Waiting> waiting_;
};

}  // namespace fxsim
