// Sets the calendar of one program, and nothing else of it: preloaded, it adds what a file says to
// CLOCK_REALTIME. SHIFTED_CLOCK names the file: 8 bytes, the shift in s as a signed integer of this
// machine, which may be changed at any time. The steady clock and every timer on it stay untouched.
//
// libfaketime was tried before: it meddles with timerfd_settime() also where the monotonic clock is
// to be left alone. asio arms a timer that is already due as the absolute time of 1 ns, which then
// never came, and with it no other timer of the program.

#include <fcntl.h>
#include <pthread.h>
#include <semaphore.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <unistd.h>

#include <atomic>
#include <cstdint>
#include <cstdlib>
#include <ctime>

namespace {

using Shift = std::atomic<std::int64_t>;
static_assert(sizeof(Shift) == 8 && Shift::is_always_lock_free);

/// In s. 0 where the file is not there, or too short.
std::int64_t shift() {
  static const Shift* const mapped = []() -> const Shift* {
    const char* path = std::getenv("SHIFTED_CLOCK");
    const int file = path == nullptr ? -1 : open(path, O_RDONLY | O_CLOEXEC);
    if (file < 0) return nullptr;
    const bool whole = lseek(file, 0, SEEK_END) >= static_cast<off_t>(sizeof(Shift));
    void* at = whole ? mmap(nullptr, sizeof(Shift), PROT_READ, MAP_SHARED, file, 0) : MAP_FAILED;
    close(file);
    return at == MAP_FAILED ? nullptr : static_cast<const Shift*>(at);
  }();
  return mapped == nullptr ? 0 : mapped->load(std::memory_order_relaxed);
}

/// The kernel's time of a moment that the program has computed from the shifted clock.
timespec unshifted(const timespec* moment) {
  timespec real = *moment;
  real.tv_sec -= shift();
  return real;
}

}  // namespace

extern "C" {

int clock_gettime(clockid_t clock, timespec* now) noexcept {
  const auto result = static_cast<int>(syscall(SYS_clock_gettime, clock, now));
  if (result == 0 && (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE))
    now->tv_sec += shift();
  return result;
}

int gettimeofday(timeval* now, void*) noexcept {
  timespec fine{};
  if (const int result = clock_gettime(CLOCK_REALTIME, &fine)) return result;
  now->tv_sec = fine.tv_sec;
  now->tv_usec = fine.tv_nsec / 1000;
  return 0;
}

time_t time(time_t* out) noexcept {
  timespec now{};
  clock_gettime(CLOCK_REALTIME, &now);
  if (out != nullptr) *out = now.tv_sec;
  return now.tv_sec;
}

// Waits until a time of the calendar: the MQTT library's. Those on the steady clock are other
// calls.

int pthread_cond_timedwait(pthread_cond_t* condition, pthread_mutex_t* mutex,
                           const timespec* until) {
  const timespec real = unshifted(until);
  return pthread_cond_clockwait(condition, mutex, CLOCK_REALTIME, &real);
}

int sem_timedwait(sem_t* semaphore, const timespec* until) {
  const timespec real = unshifted(until);
  return sem_clockwait(semaphore, CLOCK_REALTIME, &real);
}

}  // extern "C"
