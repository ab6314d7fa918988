// Logs what a bus has found besides answers: an echo, bytes that nobody asked for, and the
// beginning and end of a doubt. Field thread.
#pragma once

#include <optional>

#include "agent/config/model.h"
#include "agent/field/bus/bus.h"
#include "agent/field/link/link_device.h"
#include "agent/steady_time.h"

namespace fxagent {

class DoubtLog final {
 public:
  /// The arguments must outlive it; `devices` may be filled later.
  DoubtLog(const LinkConfig& link, const Bus& bus, const LinkDevices& devices)
      : link_(link), bus_(bus), devices_(devices) {}

  /// Logs what is new. Echo and unexpected bytes are logged once, a doubt at most once a minute.
  void look();

 private:
  const LinkConfig& link_;
  const Bus& bus_;
  const LinkDevices& devices_;
  bool echo_logged_ = false;
  bool unexpected_logged_ = false;
  bool doubt_logged_ = false;
  std::optional<SteadyTime> doubt_logged_at_;
};

}  // namespace fxagent
