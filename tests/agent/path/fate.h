// The faults of a test: on the wire, and the end of the agent at a random point.
#pragma once

#include <cstdint>
#include <random>
#include <string>
#include <string_view>

namespace fxagent::test {

/// The fault in one exchange. Unless noted otherwise, the device carries out the request.
enum class Fault : std::uint8_t {
  none,
  request_lost,   ///< not done, no answer
  answer_lost,    ///< no answer
  refused,        ///< not done
  unclear,        ///< done or not, and a gateway's exception; same as refused on other protocols
  garbled,        ///< the answer has a wrong checksum
  nonsense,       ///< not done, and the answer has a wrong checksum; without checksums, refused
  cut_short,      ///< only half of the answer arrives
  noise,          ///< other bytes before the answer
  from_another,   ///< the answer appears to come from another station
  late,           ///< the answer is late, and delays all later ones
  split,          ///< the answer arrives in two pieces
  broken_before,  ///< connection lost before the first byte: not done
  broken_within,  ///< connection lost within the frame: not done
  broken_after,   ///< connection lost after the frame
  overwritten,    ///< then another client writes another value
  count_
};

class Fate final {
 public:
  explicit Fate(std::uint32_t seed) : random_(seed) {}

  int between(int low, int high) { return std::uniform_int_distribution<int>(low, high)(random_); }
  bool one_in(int many) { return between(1, many) == 1; }

  /// Starts a new life of the agent, which ends at the n-th possible point; 0: never.
  void begin_life(int ends_at) {
    has_ended_ = false;
    ends_at_ = ends_at;
  }
  /// Marks a point at which the agent may end. Returns true if it has ended, here or earlier;
  /// nothing that it does afterwards has an effect.
  bool ends_here(std::string_view where) {
    if (!has_ended_ && ends_at_ > 0 && --ends_at_ == 0) {
      has_ended_ = true;
      ended_at_ = where;
    }
    return has_ended_;
  }
  bool has_ended() const { return has_ended_; }
  const std::string& ended_at() const { return ended_at_; }

  /// Faults per thousand exchanges.
  int faults_in_1000 = 0;
  Fault next_fault() {
    // Faults often repeat: otherwise the next attempt would cure most of them.
    const bool again = faults_in_1000 > 0 && last_fault_ != Fault::none && one_in(3);
    if (again) return last_fault_;
    last_fault_ = Fault::none;
    if (between(1, 1000) > faults_in_1000) return last_fault_;
    last_fault_ = one_in(5) ? Fault::refused
                            : static_cast<Fault>(between(1, static_cast<int>(Fault::count_) - 1));
    return last_fault_;
  }

 private:
  std::mt19937 random_;
  bool has_ended_ = false;
  int ends_at_ = 0;
  std::string ended_at_;
  Fault last_fault_ = Fault::none;
};

}  // namespace fxagent::test
