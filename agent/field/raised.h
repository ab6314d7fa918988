// A flag that is up while something is under way, exceptions and cancelled coroutines included.
// Pure.
#pragma once

namespace fxagent {

/// The flag is up as long as this lives, whatever ends it.
class Raised final {
 public:
  explicit Raised(bool& flag) : flag_(flag) { flag_ = true; }
  Raised(const Raised&) = delete;
  Raised& operator=(const Raised&) = delete;
  ~Raised() { flag_ = false; }

 private:
  bool& flag_;
};

}  // namespace fxagent
