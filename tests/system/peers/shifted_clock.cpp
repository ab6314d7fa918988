// Shifts the calendar of one program and nothing else: when preloaded, it adds an offset from a
// file to CLOCK_REALTIME. SHIFTED_CLOCK names the file: 8 bytes, the offset in s as a signed
// integer in this machine's byte order. The file may change at any time. The steady clock and all
// its timers are unaffected.
//
// libfaketime does not work here: it changes timerfd_settime() even if the monotonic clock is
// excluded. asio arms a timer that is already due at the absolute time of 1 ns; under libfaketime
// that timer never expired, and so neither did any other timer of the program.

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

/// In s. 0 if the file is missing or too short.
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

/// Converts a time computed from the shifted clock to the kernel's time.
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

// Waits until a calendar time: the MQTT library calls this. Waits on the steady clock use other
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
