// Finds tags whose bytes in the device are not a value of their type, and floats that make sense
// only in another word order. Returns each once, for the log. Pure: time is an argument. Field
// thread.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <unordered_map>
#include <unordered_set>
#include <utility>
#include <vector>

#include "agent/steady_time.h"
#include "protocol/value/point.h"
#include "protocol/value/value.h"

namespace fxagent {

struct NoValue {
  std::uint32_t tag = 0;  ///< in DeviceConfig::tags
  std::string why;        ///< includes the raw value
  std::string hint;       ///< names the other word order; empty: none
};

class NoValues final {
 public:
  /// Unpacks the bytes of the tag as another point.
  using Read = std::function<Result<Value>(const Point&)>;

  /// Records that the bytes of `tag` are no value of `point`. It is returned again after it was a
  /// value for 1 minute.
  void note_none(std::uint32_t tag, const Point& point, const Read& read, SteadyTime now);
  /// Checks the word order of a float.
  void note_value(std::uint32_t tag, const Point& point, const Value& value, const Read& read);
  /// Returns and clears the tags that were found.
  std::vector<NoValue> take() { return std::exchange(found_, {}); }

 private:
  std::vector<NoValue> found_;
  std::unordered_map<std::uint32_t, SteadyTime> none_at_;  ///< tag → when it last held no value
  std::unordered_set<std::uint32_t> odd_orders_;           ///< tags that note_value() has found
};

}  // namespace fxagent
