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

Head head_at(const std::uint8_t* frame) {
  Head head;
  std::memcpy(&head, frame, sizeof head);
  return head;
}

}  // namespace

FrameRing::FrameRing(std::size_t bytes)
    : bytes_(std::max(bytes, kLeastBytes)),
      memory_(new std::uint8_t[bytes_ + sizeof(Head) + bytes_ / 4 + kMostNote]) {}

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
  const ByteView kept = bytes.first(std::min(bytes.size(), bytes_ / 4));
  note = note.substr(0, kMostNote);
  const Head head{.at = at,
                  .after_ns = after.count(),
                  .bytes = static_cast<std::uint32_t>(kept.size()),
                  .note = static_cast<std::uint16_t>(note.size()),
                  .device = device,
                  .way = way,
                  .is_cut = kept.size() < bytes.size()};
  const std::lock_guard lock(mutex_);
  for (; first_ < next_ && begin_ >= end_ && begin_ - end_ < head.size(); ++first_) {
    begin_ += head_at(&memory_[begin_]).size();
    if (begin_ >= bytes_) begin_ = 0;
  }
  std::memcpy(&memory_[end_], &head, sizeof head);
  const auto rest = std::copy(kept.begin(), kept.end(), &memory_[end_ + sizeof head]);
  std::copy(note.begin(), note.end(), rest);
  end_ += head.size();
  if (end_ >= bytes_) end_ = 0;
  ++next_;
}

RecordedFrames FrameRing::frames(std::uint64_t since, std::size_t most) const {
  RecordedFrames out;
  std::vector<std::uint8_t> copy;
  copy.reserve(2 * bytes_);  // the last frame may end behind them
  const auto utc = std::chrono::system_clock::now();
  const auto steady = std::chrono::steady_clock::now();
  {
    const std::lock_guard lock(mutex_);
    out.next = next_;
    out.devices = devices_;
    if (since >= next_) return out;
    const std::uint64_t from =
        std::max({since, first_, next_ - std::min<std::uint64_t>(most, next_)});
    out.frames.reserve(static_cast<std::size_t>(next_ - from));
    for (auto [number, at] = std::pair(first_, begin_); number < next_; ++number) {
      const std::size_t size = head_at(&memory_[at]).size();
      if (number >= from) copy.insert(copy.end(), &memory_[at], &memory_[at + size]);
      at = at + size < bytes_ ? at + size : 0;
    }
  }
  for (std::size_t at = 0; at < copy.size();) {
    const Head head = head_at(copy.data() + at);
    const std::uint8_t* bytes = copy.data() + at + sizeof head;
    at += head.size();
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
