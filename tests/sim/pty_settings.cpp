// Reads the settings of a terminal's client. Apart from pty.cpp, because <asm/termbits.h> and
// <termios.h> cannot be included together.
#include <asm/termbits.h>
#include <sys/ioctl.h>

#include "tests/sim/pty.h"

namespace fxsim {

bool Pty::client_is_set_to(unsigned baud, std::string_view parity, bool two_stop_bits) const {
  termios2 line{};
  if (::ioctl(slave_, TCGETS2, &line) != 0) return false;
  const std::string_view its_parity = (line.c_iflag & INPCK) == 0    ? "none"
                                      : (line.c_cflag & PARODD) != 0 ? "odd"
                                                                     : "even";
  return line.c_ospeed == baud && its_parity == parity &&
         ((line.c_cflag & CSTOPB) != 0) == two_stop_bits;
}

}  // namespace fxsim
