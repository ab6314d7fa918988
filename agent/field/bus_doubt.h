// Whether what is heard on one wire can be believed. Bytes that nobody asked for may be the second
// answer to a question, or another master's: then the next answer may be one, too, and a value or
// an ACK would be wrong with good quality. From the first such bytes until some exchanges in a row
// were clean the bus is doubted. Pure: the line listens and tells. Field thread.
#pragma once

#include <cstdint>

#include "agent/messages.h"

namespace fxagent {

class BusDoubt final {
 public:
  /// So many clean exchanges in a row end a doubt. Each doubt that comes within kRelapse of the
  /// end of another one takes twice as many as that one, up to kMostExchanges.
  static constexpr std::uint32_t kCleanExchanges = 3;
  static constexpr std::uint32_t kMostExchanges = 12;
  static constexpr std::chrono::seconds kRelapse{60};

  /// Bytes were heard that nobody asked for and that may pass for an answer.
  void found_foreign(SteadyTime now);
  /// A question was answered, with silence before it and behind its answer, each as long as the
  /// slowest answer may take.
  void exchange_was_clean(SteadyTime now);
  /// A question was not answered, or not cleanly.
  void exchange_was_unclear();

  bool is_doubted() const { return exchanges_to_go_ > 0; }
  /// Foreign bytes were found within the last kRelapse: more of them may come at any moment, and
  /// the first of them may come in place of an answer. What is read is to be read twice.
  bool is_wary(SteadyTime now) const { return findings_ > 0 && now - found_ < kRelapse; }
  /// Clean exchanges that are still wanting.
  std::uint32_t exchanges_to_go() const { return exchanges_to_go_; }
  /// How often foreign bytes were found. What was asked before and after it changed cannot be told
  /// apart.
  std::uint64_t findings() const { return findings_; }
  /// How often the bus came to be doubted.
  std::uint64_t doubts() const { return doubts_; }

 private:
  std::uint64_t findings_ = 0;
  std::uint64_t doubts_ = 0;
  std::uint32_t exchanges_to_go_ = 0;
  std::uint32_t wanted_ = kCleanExchanges;
  SteadyTime found_{};  ///< the last foreign bytes
  SteadyTime ended_{};  ///< the last doubt
};

}  // namespace fxagent
