// One station of a line: a PLC, its protocol, its pending faults and the requests it has received.
// Independent of any wire: it turns a request into an Answer with a schedule.
#pragma once

#include <array>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "tests/sim/fault.h"
#include "tests/sim/personality.h"

namespace fxsim {

/// The bytes to send for one request, and when.
struct Answer {
  struct Piece {
    std::chrono::milliseconds pause{0};  // after the end of the previous piece
    Bytes bytes;
    bool paced = true;  // false: sent while the request was on the wire, as an echo is
  };
  std::chrono::milliseconds wait{0};  // minimum time from the request to the first piece
  std::vector<Piece> pieces;
  std::optional<std::chrono::milliseconds> hang_up;    // then closes the connection for this long
  std::optional<std::chrono::milliseconds> overtaken;  // delays the answer; others go first
  bool coalesced = false;                              // held back until the next answer
  bool from_elsewhere = false;                         // sent as a datagram from another port
};

/// One request that was carried out.
struct Deed {
  std::uint64_t index = 0;  // counts all deeds of the station, from 0
  std::int64_t unix_ms = 0;
  RequestKind kind = RequestKind::other;
  std::string device;
  unsigned count = 0;
  std::vector<std::uint32_t> values;
};

/// One request with its result, for the log file.
struct Exchange {
  std::string_view station;
  std::int64_t unix_ms = 0;
  const Frame& frame;
  RequestKind kind;
  const Ruling& ruling;
  bool executed;
  const Treatment& treatment;
  const Answer& answer;
};

struct Stats {
  std::array<std::uint64_t, kRequestKinds> requests{};
  std::array<std::uint64_t, kFaultKinds> faults{};
  std::uint64_t naks = 0;             // sent because of a ruling or a fault
  std::uint64_t accepted_reads = 0;   // answered with data
  std::uint64_t accepted_writes = 0;  // writes and forces carried out
  std::uint64_t bytes_in = 0;
  std::uint64_t bytes_out = 0;
  std::map<std::string, std::uint64_t> commands{};  // requests per command number
  unsigned most_read = 0;                           // points in one request
  unsigned most_written = 0;
  std::uint64_t overlaps = 0;     // requests received before an earlier one was answered
  std::uint64_t turned_away = 0;  // connections refused because of the limit
  std::uint64_t strangers = 0;    // datagrams from a port that is not allowed
};

class Station final {
 public:
  using OnExchange = std::function<void(const Exchange&)>;

  static constexpr std::size_t kQuestionsKept = 1'000;

  /// `wall_at_start` is the wall clock at `start`, the zero of the station's times. `on_exchange`
  /// may be empty. For `questions_kept` see deeds().
  Station(std::string name, std::unique_ptr<Personality> personality, Plc plc, TimePoint start,
          std::chrono::system_clock::time_point wall_at_start, OnExchange on_exchange,
          std::size_t questions_kept = kQuestionsKept);

  const std::string& name() const { return name_; }
  const Personality& personality() const { return *personality_; }
  Plc& plc() { return plc_; }
  Faults& faults() { return faults_; }
  const Stats& stats() const { return stats_; }

  /// Carries out one request at `now`.
  Answer answer(const Frame& frame, TimePoint now);

  void count_sent(std::size_t bytes) { stats_.bytes_out += bytes; }
  void count_overlap() { ++stats_.overlaps; }
  void count_turned_away() { ++stats_.turned_away; }
  void count_stranger() { ++stats_.strangers; }

  /// Returns the deeds from index `since` on, oldest first. Keeps the last 100,000 writes and
  /// forces and the last `questions_kept` others.
  std::vector<Deed> deeds(std::uint64_t since) const;

 private:
  void remember(RequestKind kind, const Ruling& ruling, std::int64_t unix_ms);
  Answer schedule(const Frame& frame, Bytes reply, const Treatment& treatment) const;

  std::string name_;
  std::unique_ptr<Personality> personality_;
  Plc plc_;
  TimePoint start_;
  std::chrono::system_clock::time_point wall_at_start_;
  OnExchange on_exchange_;
  std::size_t questions_kept_;
  Faults faults_;
  Stats stats_;
  std::uint64_t next_index_ = 0;
  std::deque<Deed> orders_;
  std::deque<Deed> questions_;
};

}  // namespace fxsim
