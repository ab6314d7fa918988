#include "agent/field/transport/transport.h"

#include <asm/termbits.h>
#include <fcntl.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <asio/posix/stream_descriptor.hpp>
#include <cerrno>
#include <system_error>
#include <utility>

#include "agent/field/transport/serial_driver.h"
#include "agent/field/transport/stream_io.h"
#include "agent/file_handle.h"
#include "agent/log/log.h"
#include "agent/process/port_access.h"

namespace fxagent {
namespace {

// Modem lines of <asm/termios.h>, which cannot be included together with <sys/ioctl.h>.
constexpr int kModemDtr = 0x002;
constexpr int kModemRts = 0x004;

// An adapter may hold a reply back for this long without a noticeable effect.
constexpr int kGoodTimerMs = 2;

std::string reason(int number) { return std::system_category().message(number); }

tcflag_t data_bits_flag(int bits) { return bits == 7 ? CS7 : CS8; }

bool is_pty(int fd) {
  unsigned int number = 0;
  return ioctl(fd, TIOCGPTN, &number) == 0 || [fd] {
    const auto link = "/proc/self/fd/" + std::to_string(fd);
    char target[64] = {};
    const auto length = readlink(link.c_str(), target, sizeof target - 1);
    return length > 0 && std::string_view(target).starts_with("/dev/pts/");
  }();
}

class SerialTransport final : public StreamTransport<asio::posix::stream_descriptor> {
 public:
  SerialTransport(const asio::any_io_executor& executor, SerialSettings settings)
      : StreamTransport(executor, settings.path), settings_(std::move(settings)) {}

  asio::awaitable<Result<void>> open(SteadyTime /*deadline*/) override {
    close();
    FileHandle file(::open(settings_.path.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC));
    if (file < 0) co_return failed("cannot be opened", errno);
    const auto ready = set_up(file);
    if (!ready) co_return ready;
    asio::error_code error;
    stream_.assign(file, error);
    if (error) co_return fail(ErrorCode::link_down, settings_.path + ": " + error.message());
    file.release();
    stream_.non_blocking(true, error);
    fault_ = 0;
    co_return Result<void>{};
  }

  Result<Bytes> discard_input() override {
    if (!stream_.is_open()) return failed("is closed", ENODEV);
    Bytes found;
    const int number = read_waiting(stream_.native_handle(), found);
    if (number == 0) return found;
    close();
    return failed("has disappeared", number);
  }

 private:
  tl::unexpected<Error> failed(std::string_view what, int number) {
    // The search for the program that holds the port takes time while other links poll. It runs
    // once per fault.
    if (number != fault_) {
      fault_ = number;
      cure_ = port_cure(settings_.path, number);
    }
    return fail(ErrorCode::link_down,
                settings_.path + " " + std::string(what) + ": " + reason(number) + cure_);
  }

  /// Makes the port exclusive and raw, and sets its speed and parity. Raises DTR, and RTS unless
  /// the kernel switches it.
  Result<void> set_up(int fd) {
    if (flock(fd, LOCK_EX | LOCK_NB) != 0) return failed("is locked", errno);
    termios2 line{};
    if (ioctl(fd, TCGETS2, &line) != 0) return failed("is not a serial port", errno);
    ioctl(fd, TIOCEXCL);

    line.c_iflag = settings_.parity == Parity::none ? 0U : static_cast<tcflag_t>(INPCK);
    line.c_oflag = 0;
    line.c_lflag = 0;
    line.c_cflag = CREAD | CLOCAL | data_bits_flag(settings_.data_bits);
    if (settings_.parity != Parity::none) line.c_cflag |= PARENB;
    if (settings_.parity == Parity::odd) line.c_cflag |= PARODD;
    if (settings_.stop_bits == 2) line.c_cflag |= CSTOPB;
    line.c_cflag |= BOTHER | (static_cast<tcflag_t>(BOTHER) << IBSHIFT);
    line.c_ispeed = static_cast<speed_t>(settings_.baud);
    line.c_ospeed = static_cast<speed_t>(settings_.baud);
    line.c_cc[VMIN] = 1;
    line.c_cc[VTIME] = 0;
    if (ioctl(fd, TCSETS2, &line) != 0) return failed("does not accept these settings", errno);

    termios2 got{};
    if (ioctl(fd, TCGETS2, &got) != 0) return failed("does not report its settings", errno);
    constexpr tcflag_t kShape = CSIZE | PARENB | PARODD | CSTOPB;
    if ((got.c_cflag & kShape) != (line.c_cflag & kShape)) {
      if (!is_pty(fd))
        return fail(ErrorCode::link_down,
                    settings_.path + " does not support these data bits, parity or stop bits");
      if (!std::exchange(told_of_pty_, true))
        log::info("serial",
                  {{"path", settings_.path}, {"note", "a pty keeps neither data bits nor parity"}});
    }

    if (settings_.rs485)
      if (const std::string fault = switch_direction(fd, *settings_.rs485); !fault.empty())
        return fail(ErrorCode::link_down, settings_.path + " " + fault);
    // A pty has no modem lines; SC-09 converters draw their power from them. With rs485, the kernel
    // switches RTS.
    const int lines = settings_.rs485 ? kModemDtr : kModemDtr | kModemRts;
    ioctl(fd, TIOCMBIS, &lines);
    set_low_latency(fd);
    ioctl(fd, TCFLSH, TCIOFLUSH);
    return {};
  }

  void set_low_latency(int fd) const {
    const LowLatency got = ask_for_low_latency(fd);
    const std::string timer = got.timer_ms ? std::to_string(*got.timer_ms) : "none";
    log::debug("serial", {{"path", settings_.path},
                          {"low_latency", got.flag_taken ? "taken" : "not offered"},
                          {"latency_timer_ms", timer}});
    if (got.timer_ms && *got.timer_ms > kGoodTimerMs)
      log::info("serial", {{"path", settings_.path},
                           {"latency_timer_ms", timer},
                           {"note",
                            "each exchange may take longer by this time: set the adapter's "
                            "latency_timer to 1, by a udev rule or as root"}});
  }

  const SerialSettings settings_;
  bool told_of_pty_ = false;
  int fault_ = 0;     ///< errno of the last failure; 0 while the port is open
  std::string cure_;  ///< remedy of that failure
};

}  // namespace

std::unique_ptr<Transport> make_serial_transport(asio::any_io_executor executor,
                                                 SerialSettings settings) {
  return std::make_unique<SerialTransport>(std::move(executor), std::move(settings));
}

}  // namespace fxagent
