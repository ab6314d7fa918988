// What befalls the agent and its lines in a test: faults on the wire, and the end of the agent at a
// place that chance picks.
#pragma once

#include <cstdint>
#include <random>
#include <string>
#include <string_view>

namespace fxagent::test {

/// What goes wrong with one exchange. Where nothing else is said the request is carried out.
enum class Fault : std::uint8_t {
  none,
  request_lost,   ///< nothing is done, nothing comes back
  answer_lost,    ///< nothing comes back
  refused,        ///< not done
  unclear,        ///< done or not, and a gateway's exception; elsewhere as refused
  garbled,        ///< the check of the answer is wrong
  cut_short,      ///< half of the answer comes
  noise,          ///< other bytes before the answer
  from_another,   ///< as if another station had answered
  late,           ///< the answer comes late, and all that is asked behind it
  split,          ///< the answer comes in two pieces
  broken_before,  ///< the connection, with no byte gone
  broken_within,  ///< with part of the frame gone: not done
  broken_after,   ///< with the frame gone
  overwritten,    ///< and then something else sets another value
  count_
};

class Fate final {
 public:
  explicit Fate(std::uint32_t seed) : random_(seed) {}

  int between(int low, int high) { return std::uniform_int_distribution<int>(low, high)(random_); }
  bool one_in(int many) { return between(1, many) == 1; }

  /// A new life of the agent, which ends at the n-th place where it may; 0: not so.
  void begin_life(int ends_at) {
    has_ended_ = false;
    ends_at_ = ends_at;
  }
  /// A place in the life of a command where the agent may end. True: it has ended, here or before;
  /// nothing that it does from now on is seen by anybody.
  bool ends_here(std::string_view where) {
    if (!has_ended_ && ends_at_ > 0 && --ends_at_ == 0) {
      has_ended_ = true;
      ended_at_ = where;
    }
    return has_ended_;
  }
  bool has_ended() const { return has_ended_; }
  const std::string& ended_at() const { return ended_at_; }

  /// Of a thousand exchanges so many have a fault.
  int faults_in_1000 = 0;
  Fault next_fault() {
    // What strikes once often strikes again: a refusal that a repeat cures is another story.
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
