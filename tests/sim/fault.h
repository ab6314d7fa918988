// Faults on demand: which requests they hit, and what they make of the answer.
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
  wrong_sum,            // carried out, check of the reply wrong
  truncated,            // carried out, reply ends early
  late,                 // carried out at once, answered late
  silent,               // not carried out, no answer
  execute_then_silent,  // carried out, no answer
  garbage_before,       // other bytes ahead of the reply
  noise_after,          // other bytes behind the reply
  echo,                 // the request comes back ahead of the reply
  split,                // the reply comes in pieces with pauses
  drop,                 // not carried out, connection gone
  plc_stopped,          // the PLC falls to STOP, then answers as always
  dead,                 // the station is silent until the fault is cleared
  exception,            // nak, as Modbus calls it
  wrong_station,        // carried out, reply as from another station
  wrong_unit,           // wrong_station, as Modbus calls it
  wrong_id,             // carried out, reply carries the transaction before
  bad_length,           // carried out, the reply's own length is nonsense
  length_short,         // carried out, the reply's own length is one word too small
  length_long,          // carried out, the reply's own length is one word too great
  longer,               // carried out, one word of data too many, and a length that says so
  shorter,              // carried out, one word of data too few, and a length that says so
  end_code_with_data,   // carried out, the reply's end code is that of an error
  wrong_header,         // carried out, reply as of another frame or command
  twice,                // carried out, the reply comes twice
  overtaken,            // carried out, answered late; what comes meanwhile is answered first
  coalesced,            // carried out, the reply comes together with the next one
  from_elsewhere,       // carried out, the datagram comes from another port
  asked_twice,          // carried out and answered twice, as a request that the network doubled
};
inline constexpr std::size_t kFaultKinds = 29;
std::string_view fault_name(FaultKind kind);
std::optional<FaultKind> find_fault(std::string_view name);
std::string fault_names();

enum class FaultMatch : std::uint8_t { any, read, write, force, enquire, control, other };
std::optional<FaultMatch> find_match(std::string_view name);
inline constexpr std::string_view kMatchNames = "any read write force enq control other";

struct Fault {
  FaultKind kind = FaultKind::nak;
  FaultMatch match = FaultMatch::any;
  int count = 1;  // how often it strikes; -1: until cleared
  int every = 1;  // strikes only each n-th request that matches
  double probability = 1.0;
  std::uint32_t seed = 1;
  // late, overtaken: of the answer; split: between pieces; twice: between the two; drop: outage
  std::chrono::milliseconds delay{0};
  std::size_t bytes = 0;  // truncated: bytes that still come, 0 = half; split: size of a piece
  Bytes other{};          // garbage_before and noise_after: what is sent
  std::optional<std::uint16_t> code{};  // nak and exception; none: the protocol's usual one
};

/// What the faults that struck make of one exchange. Several add up.
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
  std::optional<std::chrono::milliseconds> drop;  // length of the outage
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

/// The faults that wait on one station.
class Faults final {
 public:
  void add(const Fault& fault);
  void clear() { waiting_.clear(); }
  /// Is the line to be silent now, even in the middle of an answer?
  bool dead() const;
  /// Called once for each whole request, in the order of arrival: counts it and picks what strikes.
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
