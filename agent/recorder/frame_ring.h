// Keeps the newest frames of one link in a fixed block of memory. The field adds frames without an
// allocation; any thread copies them. Both hold one short mutex.
#pragma once

#include <boost/circular_buffer.hpp>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <mutex>
#include <string>
#include <string_view>
#include <vector>

#include "agent/steady_time.h"
#include "protocol/options.h"
#include "protocol/value/bytes.h"

namespace fxagent {

/// A device as a reader needs it to make its codec.
struct RecordedDevice {
  std::string name{};
  std::string protocol{};  ///< by its name in the catalogue
  Options options{};
  friend bool operator==(const RecordedDevice&, const RecordedDevice&) = default;
};

struct RecordedFrame {
  enum class Way : std::uint8_t {
    out,      ///< sent by the agent
    in,       ///< an answer
    failed,   ///< received in place of an answer; no bytes: silence
    unasked,  ///< received when no answer was due
  } way = Way::out;
  std::int64_t at_us = 0;             ///< end of the frame, µs UTC since 1970
  std::chrono::nanoseconds after{0};  ///< in, failed: since the first byte of the request
  std::uint16_t device = 0;           ///< index in RecordedFrames::devices, or kNoDevice
  Bytes bytes{};
  std::string note{};  ///< reason of a failure, in words
  friend bool operator==(const RecordedFrame&, const RecordedFrame&) = default;
};

/// Frames outside of any device, and those of devices beyond the 65,535th of a link.
inline constexpr std::uint16_t kNoDevice = 0xFFFF;

struct RecordedFrames {
  std::uint64_t next = 0;  ///< number of the frame after these, for the next call
  std::vector<RecordedDevice> devices{};
  std::vector<RecordedFrame> frames{};  ///< oldest first
};

class FrameRing final {
 public:
  /// The longest note, in bytes. A longer one is cut.
  static constexpr std::size_t kMostNote = 200;

  static constexpr std::size_t kLeastBytes = 4096;
  /// Allocates `bytes`, at least kLeastBytes. The kernel provides the memory when frames fill it.
  explicit FrameRing(std::size_t bytes);
  FrameRing(const FrameRing&) = delete;
  FrameRing& operator=(const FrameRing&) = delete;
  std::size_t bytes() const { return ring_.capacity(); }

  /// Returns the index of the device for add(). Equal devices have one index. Any thread.
  std::uint16_t number(const RecordedDevice& device);

  /// Adds a frame that ended at `at` and drops the oldest ones if there is no room. Cuts bytes
  /// beyond a quarter of the ring; the note says so. Does not allocate. Any thread.
  void add(RecordedFrame::Way way, std::uint16_t device, SteadyTime at,
           std::chrono::nanoseconds after, ByteView bytes, std::string_view note) noexcept;

  /// Returns the newest frames, at most `most`, among those numbered `since` or higher. Numbers
  /// begin at 0. Their UTC times are by the clock as it is set now. Holds the mutex while it copies
  /// the ring. Any thread.
  RecordedFrames frames(std::uint64_t since = 0, std::size_t most = SIZE_MAX) const;

 private:
  mutable std::mutex mutex_;
  // All below are under the mutex.
  boost::circular_buffer<std::uint8_t> ring_;
  std::uint64_t first_ = 0;  ///< number of the oldest frame
  std::uint64_t next_ = 0;
  std::vector<RecordedDevice> devices_;
};

}  // namespace fxagent
