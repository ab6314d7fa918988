// Keeps a flag set while an operation is in progress. Clears it even if an exception or a cancelled
// coroutine ends the operation. Pure.
#pragma once

namespace fxagent {

/// The flag is true during the lifetime of this object.
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
