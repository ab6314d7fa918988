#include "agent/recorder/frame_ring.h"

#include <algorithm>
#include <cstring>

namespace fxagent {
namespace {

/// Precedes the bytes and the note of each frame in the ring.
struct Head {
  SteadyTime at{};
  std::int64_t after_ns = 0;
  std::uint32_t bytes = 0;
  std::uint16_t note = 0;
  std::uint16_t device = 0;
  RecordedFrame::Way way{};
  bool is_cut = false;

  std::size_t size() const { return sizeof(Head) + bytes + note; }
};

}  // namespace

FrameRing::FrameRing(std::size_t bytes) : ring_(std::max(bytes, kLeastBytes)) {}

std::uint16_t FrameRing::number(const RecordedDevice& device) {
  const std::lock_guard lock(mutex_);
  const auto index =
      static_cast<std::uint16_t>(std::ranges::find(devices_, device) - devices_.begin());
  if (index == devices_.size() && index != kNoDevice) devices_.push_back(device);
  return index;
}

void FrameRing::add(RecordedFrame::Way way, std::uint16_t device, SteadyTime at,
                    std::chrono::nanoseconds after, ByteView bytes,
                    std::string_view note) noexcept {
  const ByteView kept = bytes.first(std::min(bytes.size(), ring_.capacity() / 4));
  note = note.substr(0, kMostNote);
  const Head head{.at = at,
                  .after_ns = after.count(),
                  .bytes = static_cast<std::uint32_t>(kept.size()),
                  .note = static_cast<std::uint16_t>(note.size()),
                  .device = device,
                  .way = way,
                  .is_cut = kept.size() < bytes.size()};
  const std::lock_guard lock(mutex_);
  while (ring_.reserve() < head.size()) {
    Head oldest;
    std::copy_n(ring_.begin(), sizeof oldest, reinterpret_cast<std::uint8_t*>(&oldest));
    ring_.erase_begin(oldest.size());
    ++first_;
  }
  const auto* const raw = reinterpret_cast<const std::uint8_t*>(&head);
  ring_.insert(ring_.end(), raw, raw + sizeof head);
  ring_.insert(ring_.end(), kept.begin(), kept.end());
  ring_.insert(ring_.end(), note.begin(), note.end());
  ++next_;
}

RecordedFrames FrameRing::frames(std::uint64_t since, std::size_t most) const {
  RecordedFrames out;
  std::vector<std::uint8_t> copy;
  std::uint64_t number = 0;
  const auto utc = std::chrono::system_clock::now();
  const auto steady = std::chrono::steady_clock::now();
  {
    const std::lock_guard lock(mutex_);
    out.next = next_;
    out.devices = devices_;
    number = first_;
    if (since >= next_) return out;
    copy.reserve(ring_.size());
    for (const auto& [bytes, size] : {ring_.array_one(), ring_.array_two()})
      copy.insert(copy.end(), bytes, bytes + size);
  }
  const std::uint64_t in_ring = out.next - number;
  std::uint64_t from = std::max(since, number);
  if (in_ring > most) from = std::max(from, out.next - most);
  out.frames.reserve(static_cast<std::size_t>(out.next - from));
  for (std::size_t at = 0; at < copy.size(); ++number) {
    Head head;
    std::memcpy(&head, copy.data() + at, sizeof head);
    const std::uint8_t* bytes = copy.data() + at + sizeof head;
    at += head.size();
    if (number < from) continue;
    RecordedFrame& frame = out.frames.emplace_back();
    frame.way = head.way;
    frame.at_us = utc_us(
        utc + std::chrono::duration_cast<std::chrono::system_clock::duration>(head.at - steady));
    frame.after = std::chrono::nanoseconds(head.after_ns);
    frame.device = head.device;
    frame.bytes.assign(bytes, bytes + head.bytes);
    frame.note.assign(bytes + head.bytes, bytes + head.bytes + head.note);
    if (head.is_cut) frame.note += frame.note.empty() ? "cut" : "; cut";
  }
  return out;
}

}  // namespace fxagent
