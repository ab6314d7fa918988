// The complete simulator: PLCs on their lines, the control socket, the log file.
#pragma once

#include <chrono>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "tests/sim/config.h"

namespace fxsim {

class Simulator final {
 public:
  enum class Signals : std::uint8_t { obeyed, ignored };

  struct Options {
    std::string control;  // path of the control socket; empty: none
    std::string log;      // path of the log file; empty: none
    std::optional<std::chrono::milliseconds> lifetime;
    Signals signals = Signals::ignored;  // obeyed: SIGINT and SIGTERM stop the simulator
  };

  /// Opens every line and the control socket. Throws std::system_error.
  Simulator(const std::vector<PlcConfig>& plcs, Options options);
  ~Simulator();
  Simulator(const Simulator&) = delete;
  Simulator& operator=(const Simulator&) = delete;

  /// Returns {"ready":true,"plcs":[{"name":...,"pty":...} or {"name":...,"tcp":...}]}; a UDP port
  /// appears as "udp".
  std::string ready_line() const;
  /// Serves until stop(), "quit", the end of the lifetime or a signal; then removes the files and
  /// sockets it created.
  void run();
  /// From any thread.
  void stop();

 private:
  class Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace fxsim
